"""worlds.json: a machine's parameters as they are known, its effects, and 256 joint draws, for any other program.

| key | content |
|---|---|
| ``schema``, ``version`` | ``"onlinebayes-worlds"``, 1: keys may be added, those here stay |
| ``parameters`` | name -> mean, sd, low, high (bounds), unit, scale, element (kind, names), attribute, index, effect |
| ``correlation`` | of the parameters, in their order |
| ``draws`` | 256 rows of values [SI], in their order |
| ``effects`` | key, name, target, parameters, whether plain MuJoCo has it, why not |
| ``models`` | weight and additions of each model that the log leaves open |
| ``timestep``, ``control_period`` | of the model [s] |
| ``mujoco`` | for a MuJoCo model: cells of ``mjModel`` and their values in each draw (:mod:`.cells`) |
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from onlinebayes.export.drawn import Drawn
from onlinebayes.problems import RefinedModels
from onlinebayes.runs.results import versions
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.addresses import expand

SCHEMA, VERSION = "onlinebayes-worlds", 1

_FIELD = re.compile(r"^(?P<attribute>[a-z_]+)(\[(?P<index>\d+)\])?$")


def document(models: RefinedModels, found: Drawn, left_out: Mapping[str, str]) -> dict[str, Any]:
    """The content of worlds.json without its ``mujoco``.

    Args:
        models: what ``refine`` left.
        found: draws from it.
        left_out: effects that plain MuJoCo has no term for -> why.
    """
    simulator, space = models.worlds.simulator, models.worlds.space
    dt = float(getattr(simulator, "dt", simulator.timestep))
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "source": {
            "problem": models.problems[0].path.name,
            "verdict": models.report.get("verdict"),
            "belief": found.source,
            "correlations_known": models.correlated or found.source == "posterior.json",
            "refined_with": models.report.get("versions", {}),
            "exported_with": versions(),
        },
        "timestep": float(simulator.timestep),
        "control_period": dt,
        "models": [
            {"weight": float(weight), "with": name}
            for weight, name in zip(models.worlds.weight, models.worlds.names, strict=True)
        ],
        "parameters": {
            name: {
                "mean": float(found.mean[k]),
                "sd": float(found.sd[k]),
                "low": space[name].low,
                "high": space[name].high,
                "unit": space[name].unit,
                "scale": space[name].scale,
                **_address(name, simulator),
            }
            for k, name in enumerate(space)
        },
        "correlation": found.correlation.tolist(),
        "draws": found.theta.tolist(),
        "effects": [_effect(effect, left_out) for effect in simulator.effects],
    }


def _address(name: str, simulator: object) -> dict[str, Any]:
    """The MJCF element and attribute of a parameter, or the effect that it belongs to."""
    if "@" in name:
        return {"element": None, "attribute": None, "index": None, "effect": name.rpartition(".")[0]}
    kind, _, rest = name.partition(".")
    element, _, last = rest.rpartition(".")
    field = _FIELD.match(last)
    if field is None or not isinstance(simulator, MujocoSimulator):
        return {"element": None, "attribute": None, "index": None, "effect": None}
    members = expand(simulator.model, name) if element else ()
    names = [one.partition(".")[2].rpartition(".")[0] for one in members]
    index = None if field["index"] is None else int(field["index"])
    return {
        "element": {"kind": kind, "names": names},
        "attribute": field["attribute"],
        "index": index,
        "effect": None,
    }


def _effect(effect: Effect, left_out: Mapping[str, str]) -> dict[str, Any]:
    return {
        "effect": effect.key,
        "name": effect.name,
        "target": effect.target,
        "target_kind": effect.target_kind,
        "parameters": {short: f"{effect.key}.{short}" for short in effect.parameters},
        "in_mujoco": effect.key not in left_out,
        "why_not": left_out.get(effect.key, ""),
    }
