"""A criticism of a drive as ``refine`` would give it, made without a fit: what the report's tests and looks need.

A mass on a slide (damping, dry friction F, constant load) is driven to and fro; the base model lacks friction and load
and is replayed window by window from the measured state, as criticism does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.findings.profiles import profiles
from onlinebayes.criticism.results import Candidate, Failure, HeldOutError, ParameterChange, Remainder, Step, Wiring
from onlinebayes.criticism.timing import Timing
from onlinebayes.identification.detail import Detail, HorizonError
from onlinebayes.identification.fitting.heldout import window_errors
from onlinebayes.identification.results import Estimate, FittedModel, FlatDirection, Numerics, ReplayedRun, Selection
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ActuatorLag, ConstantLoad, DryFriction
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.mujoco import MujocoSimulator

DRIVE = """
<mujoco model="drive">
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <geom name="rail" type="box" size="0.5 0.02 0.01" rgba="0.5 0.55 0.6 1"/>
    <body name="carriage" pos="0 0 0.05">
      <joint name="carriage" type="slide" axis="1 0 0" damping="100"/>
      <geom name="table" type="box" size="0.08 0.06 0.03" mass="80" rgba="0.75 0.78 0.8 1"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="carriage"/></actuator>
</mujoco>
"""
SIGNAL, VELOCITY = "qpos.carriage", "qvel.carriage"
SPACE = ParameterSpace(
    {"body.carriage.mass": Parameter(50, 150, "kg"), "joint.carriage.damping": Parameter(0, 1000, "N s/m")}
)


class Unmoved(Identifiable):
    """A simulator of the right type that is never stepped: reports read its parameters only."""

    def __init__(self, space: ParameterSpace = SPACE) -> None:
        self.parameters, self.worlds, self.dt, self.timestep = space, 1, 1e-3, 1e-3
        self.commands, self.signals, self.effects = ("motor",), (SIGNAL, VELOCITY), ()
        self.device, self.dtype = torch.device("cpu"), torch.float64

    @property
    def nominal(self) -> Tensor:
        return (self.parameters.low + self.parameters.high) / 2

    @property
    def state(self) -> TensorDict:
        raise AssertionError("a report does not simulate")

    theta = failed = state

    def reset(self, theta: Tensor, state: TensorDictBase | None = None, mask: Tensor | None = None) -> TensorDict:
        raise AssertionError("a report does not simulate")

    def step(self, inputs: TensorDictBase) -> TensorDict:
        raise AssertionError("a report does not simulate")

    def rollout(self, theta: Tensor, state: TensorDictBase, inputs: TensorDictBase, times: Tensor) -> TensorDict:
        raise AssertionError("a report does not simulate")

    def read(self, state: TensorDictBase) -> Tensor:
        raise AssertionError("a report does not simulate")

    def with_effect(self, effect: object) -> Unmoved:
        raise AssertionError("a report does not simulate")

    def with_worlds(self, worlds: int) -> Unmoved:
        raise AssertionError("a report does not simulate")


def drive() -> MujocoSimulator:
    """The drive as a MuJoCo model with the two effects that :func:`criticism` accepts."""
    effects = (
        DryFriction("carriage", Parameter(0.0, 100.0, "N")),
        ConstantLoad("carriage", Parameter(-50.0, 50.0, "N")),
    )
    return MujocoSimulator(DRIVE, SPACE, threads=1, effects=effects)


def _drive(force: NDArray[np.float64], dt: float, friction: float, load: float, q: float, v: float) -> np.ndarray:
    """Position and velocity (T, 2) of 95 kg with 200 N s/m under ``force``, Euler steps of ``dt``."""
    rows = np.empty((len(force), 2))
    for k, f in enumerate(force):
        rows[k] = q, v
        free = v + dt * (f - load - 200.0 * v) / 95.0
        v = float(np.sign(free) * max(abs(free) - dt * friction / 95.0, 0.0))
        q += dt * v
    return rows


def runs(rate: float, seconds: float) -> dict[str, tuple[ReplayedRun, ReplayedRun]]:
    """Run name -> the same run replayed by the base and by the final model; ``pulses`` is held out."""
    dt, rng = 1 / rate, np.random.default_rng(0)
    time = np.arange(round(seconds * rate)) * dt
    inputs = {
        "plain": 60 * np.sin(2 * np.pi * 0.4 * time) + 25 * np.sin(2 * np.pi * 0.17 * time),
        "pulses": 70 * np.sign(np.sin(2 * np.pi * 0.5 * time)) * (np.sin(2 * np.pi * 1.0 * time) > -0.3),
    }
    found = {}
    for name, force in inputs.items():
        truth = _drive(force, dt, 22.0, 3.4, 0.0, 0.0)
        measured = np.round((truth[:, :1] + rng.normal(0, 1e-5, (len(time), 1))) / 1e-6) * 1e-6
        pair = []
        for friction, load in ((0.0, 0.0), (20.5, 3.2)):
            window = (time // 1.0).astype(int)
            starts = [np.flatnonzero(window == w) for w in np.unique(window)]
            simulated = np.concatenate([_drive(force[i], dt, friction, load, *truth[i[0]]) for i in starts])
            pair.append(
                ReplayedRun(
                    run=name,
                    held_out=name == "pulses",
                    time=torch.as_tensor(time),
                    command=torch.as_tensor(force)[:, None],
                    measured=torch.as_tensor(measured),
                    simulated=torch.as_tensor(simulated[:, :1]),
                    qpos=torch.as_tensor(simulated[:, :1]),
                    window=torch.as_tensor(window),
                )
            )
        found[name] = (pair[0], pair[1])
    return found


def _estimate(mean: float, sd: float, unit: str, identifiable: bool = True) -> Estimate:
    return Estimate(mean, sd, mean - 1.7 * sd, mean + 1.7 * sd, unit, identifiable)


def candidates() -> tuple[Candidate, ...]:
    """One of each kind: accepted, tied, refused, not refitted, confounded."""
    return (
        Candidate(
            "dry_friction@carriage", 1, None, 212.0, 31.0, 10, True,
            parameters={"frictionloss": _estimate(22.04, 0.93, "N")}, nested_in=("stribeck_friction@carriage",),
        ),
        Candidate(
            "constant_load@carriage", 2, None, 180.0, 40.0, 10, True,
            parameters={"load": _estimate(3.41, 0.21, "N")},
            indistinguishable_from=("asymmetric_friction@carriage",),
        ),
        Candidate(
            "asymmetric_friction@carriage", 3, None, 179.0, 41.0, 10,
            parameters={
                "frictionloss_positive": _estimate(25.4, 0.9, "N"), "frictionloss_negative": _estimate(18.6, 0.9, "N"),
            },
            indistinguishable_from=("constant_load@carriage",),
        ),
        Candidate(
            "joint_stiffness@carriage", 4, None, 12.0, 14.0, 10,
            refused_because=("explains too little: gain 0.020",),
            parameters={"stiffness": _estimate(4.1, 3.9, "N/m")}, exclusion_limit=11.0,
        ),
        Candidate("actuator_delay@motor", 5, None, None, None, 10, exclusion_limit=0.0012,
                  refused_because=("not refitted: it promises a gain of 0.004",)),
        Candidate("viscous_friction@carriage", None, None, None, None, 10, confounded_with=("joint.carriage.damping",)),
    )  # fmt: skip


def detail(base: FittedModel, final: FittedModel) -> Detail:
    """Windows and profiles as criticism computes them; horizons that grow as such errors do."""
    time = tuple((k + 0.5) / 10 for k in range(10))
    horizon = HorizonError(
        SIGNAL, time, tuple(0.011 * t for t in time), tuple(0.0035 * t * t for t in time), (0.0002,) * 10
    )
    return Detail(
        window_errors(base.replays, final.replays, (SIGNAL,)),
        (horizon,),
        profiles(base.replays, final.replays, (SIGNAL,), ("motor",), {SIGNAL: "m"}),
    )


def criticism(rate: float = 100.0, seconds: float = 4.0, simulator: Identifiable | None = None) -> Criticism:
    """A ``missing_effect`` with two accepted effects; vary it with ``dataclasses.replace``."""
    simulator = simulator or Unmoved()
    replays = runs(rate, seconds)
    parameters = {
        "body.carriage.mass": _estimate(95.1, 1.5, "kg"),
        "joint.carriage.damping": _estimate(203.0, 6.2, "N s/m", identifiable=False),
    }
    effects = {f"{c.effect}.{name}": e for c in candidates()[:2] for name, e in c.parameters.items()}
    means = {name: estimate.mean for name, estimate in (parameters | effects).items()}
    theta = torch.tensor([means[name] for name in simulator.parameters], dtype=torch.float64)
    covariance = torch.eye(len(theta), dtype=torch.float64)
    base = FittedModel(
        simulator, theta, covariance, {**parameters, "body.carriage.mass": _estimate(104.0, 4.0, "kg")}, (),
        tuple(pair[0] for pair in replays.values()),
    )  # fmt: skip
    accepted = ("dry_friction@carriage", "constant_load@carriage")
    final = FittedModel(
        simulator, theta, covariance, parameters | effects, accepted, tuple(pair[1] for pair in replays.values())
    )
    return Criticism(
        command="refine",
        verdict="missing_effect",
        accepted=accepted,
        remainder=Remainder("structured", {SIGNAL: 4.1}, "|qvel.carriage| < 0.02 m/s"),
        heldout_error=HeldOutError({SIGNAL: 0.00656}, {SIGNAL: 0.00199}, {SIGNAL: 0.0002}, {SIGNAL: 1.0}),
        steps=(
            Step(accepted[0], {SIGNAL: 0.0061}, {SIGNAL: 0.0042}, 212.0, 31.0, 10),
            Step(accepted[1], {SIGNAL: 0.0042}, {SIGNAL: 0.0018}, 180.0, 40.0, 10),
        ),
        candidates=candidates(),
        candidates_tried=23,
        holdout_looks=1,
        failures=(
            Failure(SIGNAL, "|qvel.carriage| < 0.02 m/s", 0.6, 0.1),
            Failure(SIGNAL, "qvel.carriage > 0", 0.71, 0.5),
        ),
        parameters=final.parameters,
        flat_directions=(
            FlatDirection(
                "only the ratio of mass and gear is known",
                {"body.carriage.mass": 0.71, "actuator.motor.gear": 0.70},
            ),
        ),
        numerics=Numerics(1e-3, 0.04, True),
        base=base,
        final=final,
        signals=(SIGNAL,),
        commands=("motor",),
        units={SIGNAL: "m"},
        sensor_sd={SIGNAL: 1e-5},
        selection=Selection(),
        detail=detail(base, final),
        timings=(Timing("fitting the base model", 1.1), Timing("screening 23 effects", 0.4)),
        notes=("column 'qfrc.carriage' was not used: the model has no such signal",),
    )


def changed(result: Criticism) -> Criticism:
    """The same with nothing accepted and a mass of its own in every run."""
    values = {"plain": _estimate(92.0, 0.4, "kg"), "slow": _estimate(101.0, 0.5, "kg")}
    lines = '[parameters]\n"body.carriage.mass" = { low = 50, high = 150, scope = "per_run" }'
    mass = ParameterChange(
        "body.carriage.mass", values, 95.1, None, 80.0, 9.0, 10, (0.7, 0.4), ("joint.carriage.damping",), lines
    )
    rows = tuple(replace(candidate, accepted=False) for candidate in result.candidates)
    return replace(result, verdict="unexplained", accepted=(), candidates=rows, steps=(), changes=(mass,))


def lagging() -> Criticism:
    """A MuJoCo model with an accepted lag, which plain MuJoCo lacks."""
    result = criticism(rate=50.0, seconds=2.0, simulator=drive())
    lag = ActuatorLag("motor", Parameter(0.0, 0.5, "s"))
    theta = torch.cat([result.final.theta, torch.tensor([0.05], dtype=torch.float64)])
    covariance, effects = torch.eye(len(theta), dtype=torch.float64), (*result.final.effects, lag.key)
    final = replace(
        result.final, simulator=drive().with_effect(lag), theta=theta, covariance=covariance, effects=effects
    )
    return replace(result, final=final, accepted=effects)


def miswired() -> Criticism:
    """A reversed sign in place of effects: fitted to such a table the mass lies on its bound."""
    simulator = MujocoSimulator(DRIVE, SPACE, threads=1)
    result = criticism(rate=50.0, seconds=2.0)
    faulty, right = (
        {"body.carriage.mass": _estimate(mass, 0.5, "kg"), "joint.carriage.damping": _estimate(200.0, 5.0, "N s/m")}
        for mass in (150.0, 95.0)
    )
    base, mended = (
        FittedModel(
            simulator,
            torch.tensor([value.mean for value in values.values()], dtype=torch.float64),
            torch.eye(2, dtype=torch.float64),
            values,
            (),
            result.base.replays,
        )
        for values in (faulty, right)
    )
    rows = tuple(replace(candidate, accepted=False) for candidate in result.candidates)
    return replace(
        result,
        verdict="data_problem",
        accepted=(),
        steps=(),
        candidates=rows,
        base=base,
        final=base,
        parameters=faulty,
        wiring=Wiring(f"{SIGNAL}: the reversed sign", f'[signals."{SIGNAL}"]\nsign = -1', 177.0, 1.0),
        corrected=replace(mended, replays=()),
    )
