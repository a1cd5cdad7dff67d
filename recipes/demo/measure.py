"""The laboratory of the demonstration: a rig with a hidden effect, and the files that an engineer takes home."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from envs.driven_pendulum import MODEL, MeasuredSet, Protocol, record
from envs.driven_pendulum.rig import DAMPING, DELAY, MASS, NOMINAL
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import generator, write_atomic

PROBLEM = """\
schema = 1
model = "driven_pendulum.xml"
measurements = ["measurements.csv"]
holdout = [{holdout}]

[parameters]                        # what may be inferred: prior bounds in SI units
"body.bob.mass" = [0.2, 0.7]
"joint.hinge.damping" = [0.0, 0.05]

[signals."qpos.hinge"]
sd = {sd:.3g}
resolution = {resolution:.6g}

[effects]
candidates = "all"
"""


def hidden_truth(seed: int) -> dict[str, float]:
    """The rig of one seed: bob and damping off the model's nominal, and a motor that answers 60 to 80 ms late."""
    mass, damping, delay = torch.rand(3, generator=generator(seed, "demo rig"), dtype=torch.float64).tolist()
    return {
        **NOMINAL,
        MASS: 0.32 + 0.16 * mass,
        DAMPING: 0.008 + 0.012 * damping,
        DELAY: 0.06 + 0.02 * delay,
    }


def known(space: ParameterSpace, truth: Mapping[str, float]) -> Float[Tensor, " P"] | None:
    """The rig's values of a model's parameters; None where the model has others."""
    return space.vector({name: truth[name] for name in space}) if set(space) <= set(truth) else None


def measure(seed: int, protocol: Protocol) -> MeasuredSet:
    """Record runs of commands and encoder readings on the rig of this seed."""
    return record([(hidden_truth(seed), seed)], protocol)[0]


def write_problem(made: MeasuredSet, folder: Path) -> Path:
    """Write model, measurements and problem file; returns the problem file's path."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(MODEL, folder / MODEL.name)
    made.write(folder / "measurements.csv")
    text = PROBLEM.format(
        holdout=", ".join(f'"{run}"' for run in made.holdout),
        sd=made.encoder.floor,
        resolution=made.encoder.resolution,
    )
    write_atomic(folder / "problem.toml", text)
    return folder / "problem.toml"
