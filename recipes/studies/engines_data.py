"""A hopper thrown into the air in Drake, and its model for MuJoCo: a problem file that ``onlinebayes refine`` reads.

    u_j(t) = s / 3 sum of 3 sines of 1 to 4 Hz,      s = 18 to 60 N m, another one in every run

Where ``missing``, the machine has damping (or armature) of 1 at its three joints, as Gymnasium's file, and the model
has none; where ``surplus``, the machine has none and the model is the file. Masses are free within 30 %. Runs whose
joints come near their ends, or whose limbs touch one another or the floor, are drawn anew: stops and contacts are not
the same in both engines.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray
from tensordict import TensorDict
from torch import Tensor

from envs.hopper import DT, STANDARD, STANDARD_MODEL, DrakeHopper
from envs.hopper.standard import BODIES, GEAR, JOINTS
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import write_atomic

Law = Literal["damping", "armature"]
Side = Literal["missing", "surplus"]

RUNS, HELD, ROWS = 10, 2, 165
"""Runs, those of them that are held out, and rows of a run. Eight runs of 1.3 s are fitted: of seven or more the last
fit takes whole runs as its windows, in which a damping shows most."""

HORIZON = 0.4
"""Seconds of the windows that errors are reported over."""

NOISE = 1e-3
"""Of every position [m, rad]."""

FLYING = (0.0, 12.0, 0.0, -1.3, -1.3, 0.0)
"""Start of the runs: 12 m above the floor they fall for 1.3 s, the joints in the middle of their ranges [m, rad]."""

ROOM = 0.05
"""Between a joint and its ends [rad]."""

TORQUE = 60.0
"""Largest [N m]: joints move by some tenths of a radian."""

MOTORS = ("thigh", "leg", "foot")
ROOT = ("rootx", "rootz", "rooty")
SPACE = ParameterSpace({**STANDARD, **{f"joint.{j}.armature": Parameter(0.0, 4.0, "kg m2") for j in JOINTS}})


@dataclass(frozen=True)
class Case:
    """The law that parts the machine from its model, and which of the two has it."""

    law: Law
    side: Side

    @property
    def name(self) -> str:
        """``missing-damping``."""
        return f"{self.side}-{self.law}"

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
    Case("damping", "missing"),
    Case("armature", "missing"),
    Case("damping", "surplus"),
    Case("armature", "surplus"),
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
    write_atomic(folder / "problem.toml", _problem(model.compile()))
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
    while found < RUNS:
        for command, path in zip(*_thrown(machine, theta, draw), strict=True):
            if found < RUNS and touching_nothing(checked, path.numpy()).all():
                found += 1
                yield command.clone(), path.clone()


def touching_nothing(model: mujoco.MjModel, path: Float[ndarray, "T 6"]) -> Bool[ndarray, " T"]:
    """Row by row whether nothing touches anything, and no joint is near an end."""
    low, high = model.jnt_range[3:].T
    free = ((path[:, 3:] > low + ROOM) & (path[:, 3:] < high - ROOM)).all(1)
    data = mujoco.MjData(model)
    for k in np.flatnonzero(free):
        data.qpos[:] = path[k]
        mujoco.mj_fwdPosition(model, data)
        free[k] = data.ncon == 0
    return np.asarray(free)


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


def _problem(model: mujoco.MjModel) -> str:
    """Masses are free, the noise is known, all candidates are tried."""
    mass = {name: float(model.body(name).mass[0]) for name in BODIES}
    held = ", ".join(f'"run{r}"' for r in range(RUNS - HELD, RUNS))
    lines = ["schema = 1", 'model = "hopper.xml"', 'measurements = ["log.csv"]', f"holdout = [{held}]", ""]
    lines += ["[parameters]", *(f'"body.{name}.mass" = [{0.7 * m:.3g}, {1.3 * m:.3g}]' for name, m in mass.items())]
    for name in (*ROOT, *JOINTS):
        lines += ["", f'[signals."qpos.{name}"]', f"sd = {NOISE!r}"]
    return "\n".join([*lines, "", "[selection]", f"horizon_s = {HORIZON!r}", "", "[effects]", 'candidates = "all"', ""])
