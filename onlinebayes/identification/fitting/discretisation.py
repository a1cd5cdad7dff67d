"""The choice of a model's integration: the cheapest way whose error no judgement can notice.

    values:        RMS of the start-projected difference from the finest way < max(rms, noise) / 10   in every signal,
                   and steps half as long again differ by less than max(rms, noise)
    derivatives:   |c - c_fine| < |c_fine| / 20                                                   of every column

Derivatives lead a fit and need not be as good as what it is judged by: where four evaluations a step are needed for the
values, one is enough for them. A method of first order errs by half a step's delay, which passes for a late sensor or a
slow drive. A method that is at the end of its stability is fine where it was asked, and diverges once theta has moved;
the model's own step is its user's choice. Friction that sticks errs by more than what is smooth, so that the question
is asked anew for what is added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.gauss_newton import Fitted
from onlinebayes.identification.fitting.rows import rms, taken_out
from onlinebayes.identification.fitting.sensitivities import Linearisation, linearise
from onlinebayes.identification.fitting.theta import theta_of, values_of
from onlinebayes.identification.replaying.extrapolated import PARTS
from onlinebayes.identification.replaying.integration import (
    FINEST,
    Integration,
    adjustable,
    by_runge_kutta,
    first_order,
)
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.runs import BadInput, Stopped
from onlinebayes.simulators.abilities import Integrated
from onlinebayes.simulators.identifiable import Identifiable

NEGLIGIBLE = 0.1
"""Of the residual, or of the noise where that is larger."""

EVALUATIONS = {"runge_kutta": 4, "extrapolated": 1 + PARTS}
"""Of the forces in a step of a method; one where it is not told."""

ALIKE = 0.05
"""Share of a derivative by which a cheaper one may differ from it: a fit's steps are as good, to a twentieth."""

MARGIN = 1.5
"""Times that a step could be longer without diverging: the stiffness of a machine is known to some tens of percent."""

FEW = 15
"""Windows over which the finest way is played: its error hardly differs between them, and it is the dearest of all."""


@dataclass(frozen=True)
class Discretisation:
    """The integration of a model, and the one that is used where only its derivatives are asked for."""

    values: Integration
    derivatives: Integration


def ways(simulator: Integrated, row: float, stiff: bool = False) -> list[Integration]:
    """Ways to integrate a log with rows ``row`` [s] apart, the cheapest first; the own one where the step is fixed.

    Args:
        simulator: in its own way.
        row: [s].
        stiff: whether Runge's and Kutta's method diverges, so that extrapolation stands in for it.
    """
    own = simulator.timestep
    if not adjustable(simulator):
        return [Integration(own)]
    parts = max(1, round(row / own))
    steps = [row / n for n in range(1, parts + 1) if parts % n == 0] + [own / 2, own / 4, own / FINEST]
    methods = ["own", "extrapolated" if stiff else "runge_kutta"] if first_order(simulator) else ["own"]
    if by_runge_kutta(simulator) and simulator.with_first_order() is not simulator:
        methods.append("first_order")
    found = [Integration(step, method) for step in steps for method in methods]  # type: ignore[arg-type]
    return sorted(found, key=cost_of(simulator, row))


def cost_of(simulator: Integrated, row: float) -> Callable[[Integration], float]:
    """What gives a way's evaluations of the forces for one row of ``row`` [s]; the model's own method is asked once."""
    own = EVALUATIONS["runge_kutta"] if by_runge_kutta(simulator) else 1
    return lambda way: row / way.timestep * (own if way.method == "own" else EVALUATIONS.get(way.method, 1))


def finest(simulator: Integrated) -> tuple[Integration, ...]:
    """Return the integrations with which the others are compared, the best first: what is stiff may leave but the last.

    MuJoCo's own Euler takes a joint's damping as it is after the step; Runge's and Kutta's method does not, and
    diverges where the damping of a servo is large beside the inertia that it moves.
    """
    if not adjustable(simulator):
        return (Integration(simulator.timestep),)
    if first_order(simulator):
        quarter = simulator.timestep / 4
        return Integration(quarter, "runge_kutta"), Integration(quarter, "extrapolated")
    return (Integration(simulator.timestep / (4 if by_runge_kutta(simulator) else FINEST)),)


def fine_enough(fitted: Fitted, given: Identifiable, windows: Windows) -> bool:
    """Check whether a fit may be judged as it was integrated.

    Args:
        fitted: what is asked.
        given: the same hypothesis at the model's own step.
        windows: the data.
    """
    fitted, windows = _in_few(fitted, windows)
    _, exact = _finest(given, fitted, windows)
    return exact is None or bool((_errors(fitted, windows, exact) < _admissible(fitted, windows)).all())


def error_in_floors(fitted: Fitted, given: Identifiable, windows: Windows) -> tuple[float, float]:
    """Return the worst signal's integration error, and the largest residual of any; arguments as :func:`fine_enough`.

    The error is infinite where all finer ways diverge.
    """
    left = float(rms(windows, fitted.rows.in_noise(fitted.rows.residual)).max())
    fitted, windows = _in_few(fitted, windows)
    best, exact = _finest(given, fitted, windows)
    alone = best.method == "own" and adjustable(given) and not by_runge_kutta(given)
    if alone and fitted.simulator.timestep <= best.timestep:
        # Nothing is finer: at first order it errs by what it differs from steps twice as long.
        exact = _replayed(replace(best, timestep=2 * best.timestep), given, fitted, windows)
    return (float("inf") if exact is None else float(_errors(fitted, windows, exact).max())), left


def cheapest(fitted: Fitted, given: Identifiable, windows: Windows) -> Discretisation:
    """The cheapest way that is fine enough for a fit; the finest where none is."""
    fitted, windows = _in_few(fitted, windows)
    values = _values(fitted, given, windows)
    return Discretisation(values, _derivatives(fitted, given, windows, values))


def _in_few(fitted: Fitted, windows: Windows) -> tuple[Fitted, Windows]:
    """The same in a few windows, evenly spread."""
    if windows.count <= FEW:
        return fitted, windows
    some = torch.linspace(0, windows.count - 1, FEW, device=windows.run.device).round().long()
    return fitted.of(some), windows.select(some)


def _values(fitted: Fitted, given: Identifiable, windows: Windows) -> Integration:
    best, exact = _finest(given, fitted, windows)
    if exact is None:
        return Integration(given.timestep)
    admissible = _admissible(fitted, windows)
    for way in ways(given, windows.step, best.method == "extrapolated"):
        shown = _replayed(way, given, fitted, windows)
        if shown is None or not bool((_moved(fitted, windows, exact - shown) < admissible).all()):
            continue
        if way == Integration(given.timestep) or _stable(way, shown, given, fitted, windows):
            return way
    return best


def _stable(
    way: Integration, shown: Float[Tensor, "W n S"], given: Identifiable, fitted: Fitted, windows: Windows
) -> bool:
    """Check whether steps half as long again show the same, to what is left; true where a row is no longer.

    What diverges may stay finite: forces and joints have limits.
    """
    fewer = int(windows.step / way.timestep / MARGIN + 1e-6)
    if fewer < 1:
        return True
    longer = _replayed(replace(way, timestep=windows.step / fewer), given, fitted, windows)
    left = _admissible(fitted, windows) / NEGLIGIBLE
    return longer is not None and bool((_moved(fitted, windows, shown - longer) <= left).all())


def _derivatives(fitted: Fitted, given: Identifiable, windows: Windows, values: Integration) -> Integration:
    cost = cost_of(given, windows.step)
    stiff = values.method == "extrapolated"
    cheaper = [way for way in ways(given, windows.step, stiff) if cost(way) < cost(values)]
    exact = _linearised(values, given, fitted, windows) if cheaper else None
    if exact is not None:
        for way in cheaper:
            rough = _linearised(way, given, fitted, windows)
            if rough is not None and _alike(windows, fitted, rough, exact):
                return way
    return values


def _linearised(way: Integration, given: Identifiable, fitted: Fitted, windows: Windows) -> Linearisation | None:
    """At the fit's parameters and starts; None where that way diverges."""
    try:
        simulator = way.of(given)
        theta = theta_of(simulator, values_of(fitted.simulator, fitted.theta))
        found = linearise(simulator, windows, theta, fitted.lin.starts)
    except Stopped:
        raise
    except BadInput:
        return None
    return found if found.valid else None


def _alike(windows: Windows, fitted: Fitted, rough: Linearisation, exact: Linearisation) -> bool:
    """Check whether all derivatives differ by little: by the starts, and by theta with the starts taken out."""
    by_theta = [taken_out(windows, fitted.rows, one.by_theta).flatten(0, 1) for one in (rough, exact)]
    by_start = [one.by_start.flatten(0, 2) for one in (rough, exact)]
    pairs = ((by_theta[0], by_theta[1]), (by_start[0], by_start[1]))
    return all(bool(((a - b).norm(dim=0) <= ALIKE * b.norm(dim=0)).all()) for a, b in pairs)


def _finest(given: Identifiable, fitted: Fitted, windows: Windows) -> tuple[Integration, Float[Tensor, "W n S"] | None]:
    """The best way that is stable, with its replay; none where even the last diverges."""
    *better, last = finest(given)
    for best in better:
        exact = _replayed(best, given, fitted, windows)
        if exact is not None and _stable(best, exact, given, fitted, windows):
            return best, exact
    return last, _replayed(last, given, fitted, windows)


def _replayed(
    discretisation: Integration, given: Identifiable, fitted: Fitted, windows: Windows
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
