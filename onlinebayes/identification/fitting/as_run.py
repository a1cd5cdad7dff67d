"""The model run otherwise, moments, friction, integrator and step, where that follows the log far better.

    rms(own) <= 1.2 floors < rms(judged)    or    rms(own) <= 2/3 rms(judged)      ->  own

Numerics are judged against the motion itself, so that no law is blamed for what the integrator does, and dry friction
sticks. But a log may come from a simulator that integrates as coarsely as the model (a policy's rollouts, a twin), and
whose friction is MuJoCo's soft one: then the model is right as it is. And a link whose mass is free may be denser
throughout, or carry a weight at its centre: its file does not say which. Where the model grown so far leaves more than
noise, it is tried with moments that follow the masses, with soft friction, by its own method at finer steps, and at its
own step (decisions 0018, 0024, 0025).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from onlinebayes.identification.data.windows import MEMORY, Windows, make_windows
from onlinebayes.identification.fitting.descent import bounded_step
from onlinebayes.identification.fitting.fit import Fit, improve, unfitted
from onlinebayes.identification.fitting.outlying_starts import replayed_rows
from onlinebayes.identification.fitting.projection import misfit
from onlinebayes.identification.replaying.ladder import Rung, first_order
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, Stopped
from onlinebayes.simulators.identifiable import Identifiable

NOISE_FLOORS = 1.2  # floors
FAR_BETTER = 2 / 3
PROMISING_RATIO = 0.95  # before it is fitted
STEPS_A_ROW = (1, 2, 4, 5, 10, 20, 40)  # of simulators that write logs


@dataclass(frozen=True)
class AsRun:
    """A way to integrate, and what was fitted so."""

    rung: Rung
    windows: Windows
    fitted: Fit


@dataclass(frozen=True)
class RunSetup:
    """What is tried on.

    Args:
        simulator: at its own step, with the effects added so far.
        measurement: the fit runs.
        horizon: H [s].
        thorough: whether the model's own step is fitted whatever a first step promises: where a machine turns over, one
            step tells nothing of where a fit ends.
    """

    simulator: Identifiable
    measurement: Measurement
    horizon: float
    thorough: bool = False

    def windows(self, model: Identifiable, known: AsRun) -> Windows:
        """Windows at the model's step, those that are known where it is the same."""
        if model.timestep == known.rung.timestep:
            return known.windows
        return make_windows(model, self.measurement, self.horizon, MEMORY * self.horizon, known.windows.noise)


def as_run(setup: RunSetup, judged: AsRun) -> AsRun | None:
    """The model run more like its own, one change after the other; None where that is not far better in the end.

    Args:
        setup: the model, and what it is held against.
        judged: the same model fitted on the rung that its numerics asked for.
    """
    best, tried = judged, set[tuple[Rung, Rung]]()
    for changed in (_denser, _soft, _own, _finer, _finer, _own):
        if misfit(best.fitted.projected) <= NOISE_FLOORS:
            break
        for rung in changed(setup, best):
            # Once more where theta has come nearer meanwhile: far off, a step on another rung promises next to nothing.
            if rung != best.rung and (rung, best.rung) not in tried:
                tried.add((rung, best.rung))
                best = _better(setup, best, rung, setup.thorough and changed is _own) or best
    most = far_better(misfit(judged.fitted.projected))
    return best if best is not judged and misfit(best.fitted.projected) <= most else None


def far_better(left: float) -> float:
    """The most that another way to run may leave [floors], where a model leaves ``left`` of them, more than noise."""
    return max(NOISE_FLOORS, FAR_BETTER * left)


def with_soft_friction(setup: RunSetup, judged: AsRun) -> AsRun | None:
    """The model fitted on the same rung with MuJoCo's soft friction; None where it has none, or that leaves more."""
    rung = next((rung for rung in _soft(setup, judged) if rung != judged.rung), None)
    return None if rung is None else _better(setup, judged, rung, False)


def _denser(setup: RunSetup, best: AsRun) -> Iterator[Rung]:
    if setup.simulator.with_scaled_moments() is not setup.simulator:
        yield replace(best.rung, scaled_moments=True)


def _soft(setup: RunSetup, best: AsRun) -> Iterator[Rung]:
    if setup.simulator.with_soft_friction() is not setup.simulator:
        yield replace(best.rung, soft_friction=True)


def _own(setup: RunSetup, best: AsRun) -> Iterator[Rung]:
    if _refined(setup, best.rung):
        own = Rung(setup.simulator.timestep).like(best.rung)
        yield from (own.like(rung) for rung in _soft(setup, best))
        yield own


def _refined(setup: RunSetup, rung: Rung) -> bool:
    return rung.method == "runge_kutta" or rung.timestep < setup.simulator.timestep


def _finer(setup: RunSetup, best: AsRun) -> Iterator[Rung]:
    """The model's own method, where it is of first order, at the finer step that promises to leave least.

    Theta as another step had it makes up for that step's error, so that one step of theta is allowed each of them.
    """
    if not first_order(setup.simulator) or not _refined(setup, best.rung):
        return
    windows, lin, current = best.windows, best.fitted.lin, best.fitted.projected
    error = {}
    for steps in STEPS_A_ROW:
        rung = Rung(windows.step / steps).like(best.rung)
        if rung.timestep < setup.simulator.timestep:
            rows, valid = replayed_rows(rung.of(setup.simulator), windows, lin.theta[None], lin.starts[None])
            there = replace(current, residual=current.project(rows[0][..., None])[..., 0])
            left = there.objective - bounded_step(setup.simulator, there, lin.theta, 0.0)[1]
            error[rung] = left if bool(valid.all()) else float("inf")
    rung = min(error, key=error.__getitem__, default=best.rung)
    if error.get(rung, float("inf")) < PROMISING_RATIO**2 * current.objective:
        yield rung


def _better(setup: RunSetup, best: AsRun, rung: Rung, unpromising: bool) -> AsRun | None:
    """The model fitted on another rung, an ``unpromising`` one too where asked; None where that leaves more."""
    model, left = rung.of(setup.simulator), misfit(best.fitted.projected)
    try:
        windows = setup.windows(model, best)
        starts = best.fitted.lin.starts if windows.start.shape == best.windows.start.shape else None
        begun = unfitted(model, windows, best.fitted.theta, starts=starts)
    except Stopped:
        raise  # the grounds without it would be judged otherwise than the whole of the work would
    except BadInput:  # the step does not divide the rows, or the model diverges
        return None
    promising = misfit(begun.projected) < PROMISING_RATIO * left or _promised(begun) < far_better(left)
    if not promising and not unpromising:
        return None
    fitted = improve(begun, windows, math.inf if promising else best.fitted.projected.objective)
    return AsRun(rung, windows, fitted) if misfit(fitted.projected) < left else None


def _promised(begun: Fit) -> float:
    """The misfit that one step of theta promises to leave: theta as another rung had it may be far from this one's."""
    promised = bounded_step(begun.simulator, begun.projected, begun.theta, 0.0)[1]
    return misfit(begun.projected) * math.sqrt(max(0.0, 1 - promised / max(begun.projected.objective, 1e-300)))
