"""What has to be said of a fit beside its numbers.

The step, the length of the windows, convergence, values on their bounds, and laws that are another two together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from onlinebayes.criticism.searching.search import SearchResult
from onlinebayes.identification import quantities
from onlinebayes.identification.replaying.wrapper import unwrap
from onlinebayes.identification.results import Estimate, Selection
from onlinebayes.parameters import ParameterSpace
from onlinebayes.simulators.effects import EFFECTS, Effect
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.mujoco import MujocoSimulator

CUT = 0.9
"""Share of the horizon that was asked for below which windows are said to be shorter."""


def fit_notes(
    simulator: Identifiable,
    found: SearchResult,
    selection: Selection,
    parameters: Mapping[str, Estimate],
    *,
    miswired: bool,
    refined: bool,
) -> tuple[str, ...]:
    """A sentence for each such thing.

    Args:
        simulator: the base model at its own step.
        found: what the search found.
        selection: how effects were judged; its horizon was asked for.
        parameters: of the final model.
        miswired: whether a wiring fault explains more: fitted to such a table, values end on their bounds.
        refined: whether refined.xml is written.
    """
    return (
        *_of_the_step(simulator, found, refined and not miswired),
        *_of_the_windows(found, selection),
        *(
            ()
            if miswired or found.widened is not None
            else of_bounds(found.final.fitted.simulator.parameters, parameters)
        ),
        *of_sums([judged.effect for _, judged in found.accepted]),
    )


def _of_the_step(simulator: Identifiable, found: SearchResult, refined: bool) -> Iterator[str]:
    final = found.final
    if not final.numerics.sufficient:
        found_before = "; sizes of what is named carry that error" if found.accepted else ""
        yield (
            f"numerics: at the step of {final.rung.timestep:g} s the integration error is not small against what is "
            f"left, so nothing {'more ' if found.accepted else ''}is named{found_before}; give the model a finer "
            "timestep or a better integrator"
        )
    elif final.as_run:
        yield (
            f"numerics: the model's own integrator at a step of {final.rung.timestep:g} s follows the log far better "
            "than a finer one, as if a simulator had written it so; judged and kept at that step"
        )
    elif final.rung.method == "runge_kutta" or final.rung.timestep < simulator.timestep:
        yield _another_method(simulator, found, refined)
    if final.rung.soft_friction:
        yield (
            "friction: the log follows MuJoCo's own soft friction, which creeps, far better than friction that sticks, "
            "as a simulator's log would; the refined model keeps the soft one"
        )
    if final.rung.scaled_moments:
        yield (
            "moments of inertia: the data ask for bodies that are denser or lighter throughout: where a mass is free, "
            "the moments follow it (the model's own would leave far more); body.NAME.inertia[i] in [parameters] frees "
            "them instead"
        )
    if not final.fitted.converged:
        yield "the last fit did not converge fully"


def _another_method(simulator: Identifiable, found: SearchResult, refined: bool) -> str:
    """By which method and step the model was integrated in place of its own, why, and what refined.xml has of it."""
    rung = found.final.rung
    smooth = rung.method == "runge_kutta"
    method = "Runge-Kutta's method" if smooth else "its own method"
    note = (
        "numerics: so that errors of integration do not pass for missing physics, the model was integrated by "
        f"{method} in steps of {rung.timestep:g} s; its own method in steps of {simulator.timestep:g} s is not exact "
        "enough for these sensors"
    )
    if not refined or not isinstance(unwrap(simulator), MujocoSimulator):
        return note
    step = min(simulator.timestep, *(grounds.fitted.simulator.timestep for grounds in (found.base, found.final)))
    return f"{note}; refined.xml has {'integrator RK4 and ' if smooth else ''}timestep {step:g}"


def _of_the_windows(found: SearchResult, selection: Selection) -> Iterator[str]:
    lasted = found.final.windows.horizon
    if lasted < CUT * selection.horizon_s:
        yield (
            f"windows last {quantities.exact(lasted, 's')} in place of {quantities.exact(selection.horizon_s, 's')}: "
            "no run is longer without a pause"
        )


def of_bounds(space: ParameterSpace, parameters: Mapping[str, Estimate]) -> Iterator[str]:
    """A value of the model's own on its bound; zero as a lower one is where many laws end, and no surprise.

    Where the data do not determine the value they ask for nothing: it lies where the fit happened to leave it.
    """
    bounds = dict(space)
    for name, value in parameters.items():
        if value.at_bound is None or not value.identifiable or "@" in name or name not in bounds:
            continue
        end = bounds[name].low if value.at_bound == "low" else bounds[name].high
        if end != 0:
            yield (
                f"{name} ends on its bound of {quantities.exact(end, value.unit)}: the data may ask for more than was "
                "allowed, and the interval says nothing of that"
            )


def of_sums(accepted: Sequence[Effect]) -> Iterator[str]:
    """Of an accepted law that is others together, and of accepted ones that are another law: the same force."""
    keys = {effect.key for effect in accepted}
    for element in dict.fromkeys(effect.element for effect in accepted):
        for kind in EFFECTS.values():
            whole, parts = f"{kind.name}@{element}", [f"{name}@{element}" for name in kind.sum_of]
            if parts and whole in keys:
                yield f"{whole} is by its equation {' and '.join(parts)} together: no record parts the two accounts"
            elif parts and keys.issuperset(parts):
                yield f"{' and '.join(parts)} are by their equation {whole}: no record parts the two accounts"
