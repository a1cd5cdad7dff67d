"""A hopper thrown into the air in Drake, and its model for MuJoCo: a problem file that ``onlinebayes refine`` reads.

    u_j(t) = s / 3 sum of 3 sines of 1 to 4 Hz,      s = 18 to 60 N m, another one in every run

Where ``missing``, the machine has damping (or armature) of 1 at its three joints, as Gymnasium's file, and the model
has none; where ``surplus``, the machine has none and the model is the file. Masses are free within 30 %. Runs whose
joints come near their ends, or whose limbs touch one another or the floor, are drawn anew: stops and contacts are not
the same in both engines. ``from hops`` the runs are the flights of a hopper that jumps (:mod:`.engines_hops`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from envs.hopper import DT, STANDARD, STANDARD_MODEL, DrakeHopper
from envs.hopper.standard import BODIES, GEAR, JOINTS
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import write_atomic
from recipes.studies.engines_hops import flights, jumps, touching_nothing

Law = Literal["damping", "armature"]
Side = Literal["missing", "surplus"]

RUNS, HOPS, HELD, ROWS = 10, 24, 4, 165
"""Runs in flight, flights of hops; a fourth of the flights and two of the runs are held out; rows of a run. Eight runs
of 1.3 s are fitted: of seven or more the last fit takes whole runs as its windows, in which a damping shows most."""

FLIGHT, HOP = 0.4, 0.2
"""Seconds of the windows that errors are reported over."""

NOISE = 1e-3
"""Of every position [m, rad]."""

FLYING = (0.0, 12.0, 0.0, -1.3, -1.3, 0.0)
"""Where runs begin: 12 m above the floor they fall for 1.3 s, the joints in the middle of their ranges [m, rad]."""

ROOM = 0.05
"""Between a joint and its ends [rad]."""

TORQUE = 60.0
"""Largest [N m]: joints move by some tenths of a radian."""

MOTORS = ("thigh", "leg", "foot")
ROOT = ("rootx", "rootz", "rooty")
SPACE = ParameterSpace({**STANDARD, **{f"joint.{j}.armature": Parameter(0.0, 4.0, "kg m2") for j in JOINTS}})


@dataclass(frozen=True)
class Case:
    """What parts the machine from its model."""

    law: Law
    side: Side
    hops: bool = False

    @property
    def name(self) -> str:
        """``missing-damping``, ``missing-damping-from-hops``."""
        return f"{self.side}-{self.law}{'-from-hops' if self.hops else ''}"

    @property
    def machine(self) -> float:
        """Of the law at each joint [SI]."""
        return 1.0 if self.side == "missing" else 0.0

    @property
    def sought(self) -> frozenset[str]:
        """Keys of what must be named, as effects."""
        effect = "viscous_friction" if self.law == "damping" else "armature"
        return frozenset(f"{effect}@{joint}" for joint in JOINTS)


CASES = (
    *(Case(law, side) for side in ("missing", "surplus") for law in ("damping", "armature")),
    Case("damping", "missing", hops=True),
)


def written(case: Case, seed: int, folder: Path) -> Path:
    """Record a case and write it; the path of its problem file."""
    draw = torch.Generator().manual_seed(seed)
    model = model_of(case)
    runs = list(_runs(case, draw))
    for _, path in runs:
        path += NOISE * torch.randn(path.shape, generator=draw, dtype=path.dtype)
    write_atomic(folder / "hopper.xml", model.to_xml())
    write_atomic(folder / "log.csv", "\n".join(_lines(runs)) + "\n")
    write_atomic(folder / "problem.toml", _problem(model.compile(), len(runs), HOP if case.hops else FLIGHT))
    return folder / "problem.toml"


def model_of(case: Case) -> mujoco.MjSpec:
    """Gymnasium's hopper with names for its motors, without the law where the model misses it."""
    spec = mujoco.MjSpec.from_file(str(STANDARD_MODEL))
    for motor, name in zip(spec.actuators, MOTORS, strict=True):
        motor.name = name
    for joint in (spec.joint(name) for name in JOINTS) if case.side == "missing" else ():
        if case.law == "damping":
            joint.damping = np.zeros(3)
        else:
            joint.armature = 0.0
    spec.compile()
    return spec


def _runs(case: Case, draw: torch.Generator) -> Iterator[tuple[Float[Tensor, "T 3"], Float[Tensor, "T 6"]]]:
    """Commands and positions of runs that touch nothing."""
    machine = DrakeHopper(SPACE, RUNS)
    values = dict(zip(SPACE, machine.nominal.tolist(), strict=True))
    values |= {f"joint.{joint}.{case.law}": case.machine for joint in JOINTS}
    theta, checked, found = SPACE.vector(values).expand(RUNS, -1), model_of(case).compile(), 0
    while found < (HOPS if case.hops else RUNS):
        command, path = _thrown(machine, theta, draw)
        if case.hops:
            command, path = jumps(machine, theta, command, GEAR, draw)
        for one, way in zip(command, path, strict=True):
            free = touching_nothing(checked, way.numpy(), ROOM)
            for part in flights(free) if case.hops else [slice(None)] * bool(free.all()):
                if found < (HOPS if case.hops else RUNS):
                    found += 1
                    yield one[part].clone(), way[part].clone()


def _thrown(
    machine: DrakeHopper, theta: Float[Tensor, "R P"], draw: torch.Generator
) -> tuple[Float[Tensor, "R T 3"], Float[Tensor, "R T 6"]]:
    """One attempt at every run."""

    def uniform(*shape: int) -> Tensor:
        return torch.rand(RUNS, *shape, generator=draw, dtype=torch.float64)

    def normal(sd: float) -> Tensor:
        """Of the angles alone."""
        found = sd * torch.randn(RUNS, 6, generator=draw, dtype=torch.float64)
        found[:, :2] = 0.0
        return found

    times = DT * torch.arange(ROWS, dtype=torch.float64)
    turns = (1 + 3 * uniform(1, 3, 3)) * times[:, None, None] + uniform(1, 3, 3)
    command = TORQUE / GEAR * (0.3 + 0.7 * uniform(1, 1)) * (2 * torch.pi * turns).sin().mean(-1)
    qpos = torch.tensor(FLYING, dtype=torch.float64) + normal(0.1)
    start = TensorDict({"qpos": qpos, "qvel": normal(0.3)}, batch_size=[RUNS])
    held = TensorDict({"command": command[:, :-1]}, batch_size=[RUNS, ROWS - 1])
    path = machine.rollout(theta, start, held, times[1:])["qpos"]
    return command, torch.cat([qpos[:, None], path], dim=1)


def _lines(runs: Sequence[tuple[Tensor, Tensor]]) -> Iterator[str]:
    """The table."""
    yield ",".join(
        ["run", "time", *(f"ctrl.{name}" for name in MOTORS), *(f"qpos.{name}" for name in (*ROOT, *JOINTS))]
    )
    for r, (command, path) in enumerate(runs):
        for k, (u, q) in enumerate(zip(command.tolist(), path.tolist(), strict=True)):
            yield ",".join([f"run{r}", f"{k * DT:.3f}", *(f"{x:.9g}" for x in u), *(f"{x:.6f}" for x in q)])


def _problem(model: mujoco.MjModel, runs: int, horizon: float) -> str:
    """Masses are free, the noise is known, all candidates are tried."""
    mass = {name: float(model.body(name).mass[0]) for name in BODIES}
    held = ", ".join(f'"run{r}"' for r in range(runs - runs // HELD, runs))
    lines = ["schema = 1", 'model = "hopper.xml"', 'measurements = ["log.csv"]', f"holdout = [{held}]", ""]
    lines += ["[parameters]", *(f'"body.{name}.mass" = [{0.7 * m:.3g}, {1.3 * m:.3g}]' for name, m in mass.items())]
    for name in (*ROOT, *JOINTS):
        lines += ["", f'[signals."qpos.{name}"]', f"sd = {NOISE!r}"]
    return "\n".join([*lines, "", "[selection]", f"horizon_s = {horizon!r}", "", "[effects]", 'candidates = "all"', ""])
