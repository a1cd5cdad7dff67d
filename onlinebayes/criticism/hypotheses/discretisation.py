"""How finely the model is integrated: the cheapest way whose error no judgement can notice.

    error = RMS of the start-projected difference from the finest way,    fine enough: error < max(rms, noise) / 10

in every signal. A method of first order errs by half a step's delay, which passes for a late sensor or a slow drive;
friction that sticks errs by more than what is smooth, so that the question is asked anew for what is added.
"""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.hypotheses.fitting import Fitted
from onlinebayes.criticism.hypotheses.hypothesis import theta_of, values_of
from onlinebayes.criticism.hypotheses.rows import rms, taken_out
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.replaying.ladder import Rung, adjustable, by_runge_kutta, first_order
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.runs import BadInput, Stopped
from onlinebayes.simulators.identifiable import Identifiable

NEGLIGIBLE = 0.1
"""Of the residual, or of the noise where that is larger."""

EVALUATIONS = 4
"""Of the forces in a step of Runge's and Kutta's method."""


def ways(simulator: Identifiable, row: float) -> list[Rung]:
    """Ways to integrate a log with rows ``row`` [s] apart, the cheapest first; the own one where the step is fixed."""
    own = simulator.timestep
    if not adjustable(simulator):
        return [Rung(own)]
    parts = max(1, round(row / own))
    steps = [row / n for n in range(1, parts + 1) if parts % n == 0] + [own / 2, own / 4, own / 16]
    methods = ["own", "runge_kutta"] if first_order(simulator) else ["own"]
    found = [Rung(step, method) for step in steps for method in methods]  # type: ignore[arg-type]
    return sorted(found, key=lambda discretisation: cost(simulator, discretisation, row))


def cost(simulator: Identifiable, discretisation: Rung, row: float) -> float:
    """Evaluations of the forces for one row."""
    fourth = discretisation.method == "runge_kutta" or by_runge_kutta(simulator)
    return row / discretisation.timestep * (EVALUATIONS if fourth else 1)


def finest(simulator: Identifiable) -> Rung:
    """What the others are compared with."""
    if not adjustable(simulator):
        return Rung(simulator.timestep)
    if first_order(simulator) or by_runge_kutta(simulator):
        return Rung(simulator.timestep / 4, "runge_kutta" if first_order(simulator) else "own")
    return Rung(simulator.timestep / 16)


def fine_enough(fitted: Fitted, given: Identifiable, windows: Windows) -> bool:
    """Whether a fit may be judged as it was integrated.

    Args:
        fitted: what is asked.
        given: the same hypothesis at the model's own step.
        windows: the data.
    """
    exact = _replayed(finest(given), given, fitted, windows)
    return exact is None or bool((_errors(fitted, windows, exact) < _admissible(fitted, windows)).all())


def cheapest(fitted: Fitted, given: Identifiable, windows: Windows) -> Rung:
    """The cheapest way that is fine enough for a fit; the finest where none is."""
    best = finest(given)
    exact = _replayed(best, given, fitted, windows)
    if exact is None:
        return Rung(given.timestep)
    admissible = _admissible(fitted, windows)
    for discretisation in ways(given, windows.step):
        shown = _replayed(discretisation, given, fitted, windows)
        if shown is not None and bool((_moved(fitted, windows, exact - shown) < admissible).all()):
            return discretisation
    return best


def _replayed(
    discretisation: Rung, given: Identifiable, fitted: Fitted, windows: Windows
) -> Float[Tensor, "W n S"] | None:
    """The replay of the fit's parameters and starts; None where that way diverges."""
    try:
        simulator = discretisation.of(given)
        theta = theta_of(simulator, values_of(fitted.simulator, fitted.theta))
        shown, valid = replay_binned(simulator, windows, theta[None], fitted.lin.starts[None])
    except Stopped:
        raise
    except BadInput:
        return None
    return shown[0] if bool(valid.all()) else None


def _errors(fitted: Fitted, windows: Windows, exact: Float[Tensor, "W n S"]) -> Float[Tensor, " S"]:
    return _moved(fitted, windows, exact - (windows.bin(windows.value) - fitted.lin.residual))


def _admissible(fitted: Fitted, windows: Windows) -> Float[Tensor, " S"]:
    left = fitted.rows.in_noise(fitted.rows.residual)
    return NEGLIGIBLE * rms(windows, left).clamp_min(1.0)


def _moved(fitted: Fitted, windows: Windows, moved: Float[Tensor, "W n S"]) -> Float[Tensor, " S"]:
    rows = taken_out(windows, fitted.rows, moved[..., None])[..., 0]
    return rms(windows, fitted.rows.in_noise(rows))
