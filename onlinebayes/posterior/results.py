"""The posterior of a model's parameters given a log, as frozen values; nothing in these classes computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference import Identifiability, TruncatedMixture
from onlinebayes.parameters import ParameterSpace


@dataclass(frozen=True)
class ParameterBelief:
    """One parameter [``unit``].

    Args:
        mean, sd: of the posterior.
        q05, q50, q95: its quantiles.
        unit: SI unit.
        of_prior: its sd as a share of the prior's, counted on the parameter's own scale: 1 where nothing was learnt.
        fitted: by least squares.
    """

    mean: float
    sd: float
    q05: float
    q50: float
    q95: float
    unit: str
    of_prior: float
    fitted: float


@dataclass(frozen=True)
class Reproduction:
    """Error of the posterior's worlds against the fit runs in one signal, from each window's best start [its unit].

    Args:
        rms: measured - simulated, median over the posterior.
        q05, q95: its quantiles over the posterior.
        noise: of the sensor, as averaged over the bins that are compared.
        unit: SI unit.
    """

    rms: float
    q05: float
    q95: float
    noise: float
    unit: str


@dataclass(frozen=True)
class Method:
    """Method and data by which a posterior was made.

    Args:
        draws: replays of all windows, each at one theta.
        effective: equally weighted draws that these are worth.
        linear: whether these were too few, so that the model is taken as linear around its fit.
        windows: number of windows.
        horizon_s: their length [s].
        blocks: parts of the data whose differences give the spread of the error, as many equal ones as they are worth.
        correlation_s: correlation time of the residual [s].
        freedom: degrees of freedom of Student's t.
        runs: that were fitted.
    """

    draws: int
    effective: float
    linear: bool
    windows: int
    horizon_s: float
    blocks: float
    correlation_s: float
    freedom: float
    runs: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class LogPosterior:
    """The posterior of one model given a log.

    Args:
        belief: the distribution, to draw from, to save, to train in.
        accepted: effects that the model has.
        parameters: name -> what is known of it.
        correlation: between the parameters.
        identifiability: which parameters are known, and which only together.
        reproduction: signal -> how well it is followed.
        surprise: p of a measurement as strange as this one, were the model right and the noise that of the sensors.
        strange: signal that is missed most, against what the model could make.
        method: how it was made.
        weight: how far the model is to be believed beside others that the log leaves open.
        notes: what else a reader should know, a sentence each.
    """

    belief: TruncatedMixture
    accepted: tuple[str, ...]
    parameters: Mapping[str, ParameterBelief]
    correlation: Float[Tensor, "P P"]
    identifiability: Identifiability
    reproduction: Mapping[str, Reproduction]
    surprise: float
    strange: str
    method: Method
    weight: float = 1.0
    notes: tuple[str, ...] = ()

    @property
    def space(self) -> ParameterSpace:
        """The parameters, with the bounds of the prior."""
        return self.belief.space
