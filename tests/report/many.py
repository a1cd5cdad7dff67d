"""A criticism of an arm with many joints and many candidates: what must stay readable."""

from __future__ import annotations

import dataclasses

import torch

from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.findings.profiles import profiles
from onlinebayes.criticism.results import Candidate, Failure, HeldOutError, Remainder
from onlinebayes.identification.detail import Detail
from onlinebayes.identification.fitting.heldout import window_errors
from onlinebayes.identification.results import Estimate, FittedModel
from onlinebayes.parameters import Parameter, ParameterSpace
from tests.report.synthetic import Unmoved, criticism


def many(joints: int = 12, candidates: int = 150) -> Criticism:
    """The drive's result, its signal given to every joint with an error of its own, and as many candidates."""
    result = criticism(rate=50.0, seconds=4.0)
    signals = tuple(f"qpos.right_arm_joint_{j}" for j in range(joints))
    size = torch.linspace(1.0, 0.1, joints, dtype=torch.float64)
    names = [f"joint.right_arm_joint_{j}.damping" for j in range(joints)]
    space = ParameterSpace({name: Parameter(0.01, 10.0, "N m s/rad", "log") for name in names})
    estimates = {name: Estimate(0.4, 0.02, 0.37, 0.43, "N m s/rad", j % 3 > 0) for j, name in enumerate(names)}

    def spread(model: FittedModel) -> FittedModel:
        replays = tuple(
            dataclasses.replace(
                run,
                measured=run.measured.expand(-1, joints),
                simulated=run.measured + (run.simulated - run.measured) * size,
            )
            for run in model.replays
        )
        return dataclasses.replace(model, simulator=Unmoved(space), parameters=estimates, replays=replays)

    base, final = spread(result.base), spread(result.final)
    units = dict.fromkeys(signals, "rad")
    by_signal = {signal: float(s) for signal, s in zip(signals, size, strict=True)}
    (horizon,) = result.detail.horizons
    detail = Detail(
        window_errors(base.replays, final.replays, signals),
        tuple(dataclasses.replace(horizon, signal=signal) for signal in signals),
        profiles(base.replays, final.replays, signals, ("motor",), units),
    )
    return dataclasses.replace(
        result, base=base, final=final, signals=signals, units=units, detail=detail, steps=(), parameters=estimates,
        sensor_sd=dict.fromkeys(signals, 1e-5),
        accepted=("dry_friction@right_arm_joint_0",),
        candidates=tuple(_candidate(k, joints) for k in range(candidates)), candidates_tried=candidates,
        failures=tuple(Failure(signal, f"|qvel.{signal[5:]}| < 0.02 rad/s", 0.6, 0.1) for signal in signals),
        remainder=Remainder("structured", by_signal, "qpos.right_arm_joint_0 > 0.2 rad"),
        heldout_error=HeldOutError(
            *({signal: unit * s for signal, s in by_signal.items()} for unit in (0.0066, 0.002)),
            dict.fromkeys(signals, 0.0002), dict.fromkeys(signals, 1.0),
        ),
    )  # fmt: skip


def _candidate(k: int, joints: int) -> Candidate:
    """The first is accepted, every fifth confounded, the others were not refitted."""
    effect = f"dry_friction@right_arm_joint_{k}" if k < joints else f"actuator_delay@right_arm_motor_{k}"
    if k == 0:
        size = {"frictionloss": Estimate(22.0, 0.9, 20.5, 23.5, "N m")}
        return Candidate(effect, 1, None, 212.0, 31.0, 10, True, parameters=size)
    if k % 5 == 0:
        free = tuple(f"joint.right_arm_joint_{j}.damping" for j in range(3))
        return Candidate(effect, None, None, None, None, 10, confounded_with=free)
    return Candidate(
        effect,
        k + 1,
        None,
        None,
        None,
        10,
        exclusion_limit=0.1,
        refused_because=("not refitted: it promises a gain of 0.004",),
    )
