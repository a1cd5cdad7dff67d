"""MuJoCo's part of an export: refined.xml at the mean of the draws, and the cells of the model that these move."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch

from onlinebayes.export.cells import cells_of
from onlinebayes.export.drawn import Drawn
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.export import in_folder
from onlinebayes.simulators.mujoco.foreign import samples
from onlinebayes.simulators.mujoco.model import compile_spec

MODEL = "refined.xml"
ASSETS = "refined_assets"
"""Folder beside it for meshes and textures that the model had in memory."""

JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


@dataclass(frozen=True)
class MujocoPart:
    """The parts that MuJoCo's targets need.

    Args:
        xml: text of refined.xml.
        assets: path from the folder -> content.
        section: ``mujoco`` of worlds.json.
        actuators: ``actuators`` of worlds.json.
        left_out: effects that plain MuJoCo has no term for -> why.
    """

    xml: str
    assets: Mapping[str, bytes]
    section: Mapping[str, Any]
    actuators: Mapping[str, Any]
    left_out: Mapping[str, str]


def mujoco_part(simulator: MujocoSimulator, found: Drawn, folder: Path) -> MujocoPart:
    """Make them for a folder.

    Args:
        simulator: with the additions of all models.
        found: draws of its parameters.
        folder: that refined.xml will lie in.

    Raises:
        BadInput: MuJoCo refuses the model at the mean.
    """
    left_out = _left_out(simulator, found)
    space = simulator.parameters
    mean = space.clamp(found.mean)
    delays = [one for one in simulator.effects if isinstance(one, ActuatorDelay) and one.key not in left_out]
    try:
        spec = simulator.export(mean)
        for effect in delays:
            longest = float(found.theta[:, space.index(f"{effect.key}.delay")].max())
            spec.actuator(effect.target).nsample = samples(longest, simulator.timestep)
        xml, assets = in_folder(spec, folder, ASSETS)
        model = compile_spec(spec)
    except (ValueError, mujoco.FatalError) as error:
        raise BadInput(f"MuJoCo refuses the refined model: {error}", "mend the MJCF, and refine again") from error
    cells, values = cells_of(simulator, model, mean.numpy(), found.theta.numpy())
    section = {
        "model": MODEL,
        "left_out": dict(left_out),
        "cells": [asdict(cell) for cell in cells],
        "values": values.tolist(),
    }
    return MujocoPart(xml, assets, section, _actuators(model, delays, simulator, found), left_out)


def _left_out(simulator: MujocoSimulator, found: Drawn) -> dict[str, str]:
    """Effects that MuJoCo has no term for in some draw."""
    left: dict[str, str] = {}
    for theta in (found.mean, *found.theta):
        left |= simulator.not_exportable(simulator.parameters.clamp(theta))
    varying = {name for name, sd in zip(simulator.parameters, found.sd.tolist(), strict=True) if sd > 0}
    neutral = {
        effect.key
        for effect in simulator.effects
        if not any(f"{effect.key}.{short}" in varying for short in effect.parameters)
        and all(
            math.isclose(float(found.mean[simulator.parameters.index(f"{effect.key}.{short}")]), value, abs_tol=1e-15)
            for short, value in effect.neutral.items()
        )
    }
    return {key: why for key, why in left.items() if key not in neutral}


def _actuators(
    model: mujoco.MjModel, delays: list[ActuatorDelay], simulator: MujocoSimulator, found: Drawn
) -> dict[str, Any]:
    """Delays in timesteps, and the joints of position servos."""
    steps = {}
    for effect in delays:
        drawn = found.theta[:, simulator.parameters.index(f"{effect.key}.delay")] / simulator.timestep
        low, high = (round(float(torch.quantile(drawn, q))) for q in (0.05, 0.95))
        steps[effect.target] = {"min": low, "max": max(low, high)}
    servos = {
        model.actuator(i).name: model.joint(int(model.actuator_trnid[i, 0])).name
        for i in range(model.nu)
        if int(model.actuator_trntype[i]) in JOINT
        and model.actuator_biastype[i] == int(mujoco.mjtBias.mjBIAS_AFFINE)
        and np.isclose(model.actuator_gainprm[i, 0], -model.actuator_biasprm[i, 1])
    }
    return {"delay_steps": steps, "servo_joints": servos}
