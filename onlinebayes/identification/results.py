"""Results of a fit and its replays, as frozen values; nothing in these classes computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class Selection:
    """Settings for the judgement of effects.

    Args:
        folds: number of blocks, or None for as many as the data allow (at most 12; one a run from 7 runs on).
        horizon_s: length of the windows that errors are reported over [s].
        alpha: level of the screening test of earlier versions; read, and of no effect.
        tolerance: rms_over_floor up to which a model with nothing missing is called adequate.
        fixed_horizon: whether windows keep that length; else a machine that is unstable in open loop gets shorter ones
            (see :mod:`.fitting.horizon`).
    """

    folds: int | None = None
    horizon_s: float = 1.0
    alpha: float = 0.03
    tolerance: float = 1.2
    fixed_horizon: bool = False


@dataclass(frozen=True)
class Estimate:
    """One fitted parameter: mean, sd and the 5 and 95 % points [``unit``], from the leave-one-block-out jackknife.

    ``identifiable`` is False where the parameter lies along a direction that the data leave flat; ``at_bound`` is
    ``"low"`` or ``"high"`` where the mean lies on that end of what was allowed: the data may ask for more, and the sd
    says nothing of that.
    """

    mean: float
    sd: float
    q05: float
    q95: float
    unit: str
    identifiable: bool = True
    at_bound: Literal["low", "high"] | None = None


@dataclass(frozen=True)
class Numerics:
    """The check that the integration step is fine enough to judge by.

    Args:
        timestep: the step that criticism used [s].
        error_at_quarter_step: how far the replay moves when the step is divided by 4 [floors].
        sufficient: whether that is below a tenth of the residual, or of the floor; or the model follows the log far
            better as it was given than with a finer step.
    """

    timestep: float
    error_at_quarter_step: float
    sufficient: bool


@dataclass(frozen=True)
class FlatDirection:
    """A combination of parameters that the data do not determine, in words, and its direction: name -> component."""

    description: str
    direction: Mapping[str, float]


@dataclass(frozen=True)
class ReplayedRun:
    """One run as measured and as simulated window by window, each window from its smoothed measured start.

    Args:
        run: its name.
        held_out: whether it was kept from the fit.
        time: rows [s], padding removed.
        command: what was commanded.
        measured: the signals, nan where not measured.
        simulated: the same signals of the model.
        qpos: the model's joint positions, for drawing its geometry.
        window: number of the window that each row belongs to.
    """

    run: str
    held_out: bool
    time: Float[Tensor, " T"]
    command: Float[Tensor, "T U"]
    measured: Float[Tensor, "T S"]
    simulated: Float[Tensor, "T S"]
    qpos: Float[Tensor, "T Q"]
    window: Int[Tensor, " T"]


@dataclass(frozen=True)
class FittedModel:
    """A simulator with its parameters fitted.

    Args:
        simulator: with its effects added.
        theta: the mode, in the order of ``simulator.parameters`` [SI].
        covariance: of theta, from the jackknife over blocks [SI].
        parameters: address -> estimate.
        effects: keys of the effects that ``simulator`` carries.
        replays: fit runs first, then the held-out ones (none while those stay closed).
    """

    simulator: Identifiable
    theta: Float[Tensor, " P"]
    covariance: Float[Tensor, "P P"]
    parameters: Mapping[str, Estimate]
    effects: tuple[str, ...]
    replays: tuple[ReplayedRun, ...]
