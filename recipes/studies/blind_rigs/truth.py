"""The reference of the truth: the hidden effects added by hand, fitted from their true values, on the held-out runs.

A number of the model that is off is freed, and fitted from the machine's.

The library never sees this. The fit begins at the truth, so that a fit that fails elsewhere costs refine, not the
reference. Thermal derating counts its heat in units of a reference force that is the library's own choice:

    f / (1 + c h):   c h is the same for c' = c (f_ref' / f_ref)^2
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from envs.rigs import RIGS, BlindCase
from onlinebayes.criticism import SCALES_HORIZON, grown, propose
from onlinebayes.identification import (
    MEMORY,
    Fitted,
    begun_best,
    fit,
    make_windows,
    replay_error,
    replay_runs,
    split,
    windows_to_replay,
)
from onlinebayes.problems import ProblemFile
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import EFFECTS, ThermalDerating
from onlinebayes.simulators.identifiable import Identifiable
from recipes.studies.blind_rigs.names import address_of, spelt


def true_error(
    made: BlindCase, problem: ProblemFile, stepped: Identifiable, floor: Mapping[str, float], without: str = ""
) -> float | None:
    """Held-out error of the model with the hidden effects, fitted [floors]; None where the library lacks one.

    Args:
        made: the case.
        problem: as it was loaded, with the windows that refine used.
        stepped: the base model as refine integrated it in the end; the true one is integrated alike.
        floor: signal -> floor that errors are counted in.
        without: a hidden effect, as the library spells it, that is left out of the model.
    """
    keys = [key for hidden in made.hidden if (key := spelt(hidden, made.truth)) != without]
    numbers = [key for key in keys if key in problem.simulator.own_numbers]
    keys = [key for key in keys if key not in numbers]
    if not keys + numbers or any(key.split("@")[0] not in EFFECTS for key in keys):
        return None
    fit_runs, _ = split(problem.measurement, problem.holdout)
    horizon = problem.selection.horizon_s
    scales = make_windows(problem.simulator, fit_runs, SCALES_HORIZON)  # as the search has it: bounds follow from them
    effects = propose(problem.simulator, scales, keys) if keys else ()
    try:
        for name in numbers:
            stepped = stepped.with_free(name, problem.simulator.own_numbers[name])
        model = grown(stepped, effects)
        windows = make_windows(model, fit_runs, horizon, MEMORY * horizon)
        fitted = fit(model, windows, true_theta(made, model).to(windows.start))
        return held_error(problem, fitted, windows.noise, floor)
    except BadInput:  # at this step the true model diverges
        return None


def held_error(problem: ProblemFile, fitted: Fitted, noise: Float[Tensor, " S"], floor: Mapping[str, float]) -> float:
    """RMS over the held-out windows of a fitted model, as the report counts it [floors].

    Args:
        problem: gives the runs.
        fitted: the model.
        noise: of each signal [SI].
        floor: signal -> floor.
    """
    model, theta, horizon = fitted.simulator, fitted.theta, problem.selection.horizon_s
    _, held = split(problem.measurement, problem.holdout)
    signals = tuple(signal.name for signal in held.signals)
    windows = windows_to_replay(model, held, theta, horizon, noise)
    windows = begun_best(model, windows, theta, held_out=True)
    error = replay_error(replay_runs(model, windows, theta, held_out=True), signals)
    return in_floors(error, floor)


def in_floors(error: Mapping[str, float], floor: Mapping[str, float]) -> float:
    """RMS over signals of their errors, each over its floor; signals without an error are left out."""
    squares = [(value / floor[name]) ** 2 for name, value in error.items() if not math.isnan(value)]
    return math.sqrt(sum(squares) / len(squares)) if squares else math.nan


def true_theta(made: BlindCase, model: Identifiable) -> Float[Tensor, " P"]:
    """The rig's values of the model's parameters, inside their bounds; nominal where the rig has no such value."""
    known = true_values(made, model)
    values = [known.get(name, float(nominal)) for name, nominal in zip(model.parameters, model.nominal, strict=True)]
    return model.parameters.clamp(torch.tensor(values, dtype=torch.float64))


def true_values(made: BlindCase, model: Identifiable) -> dict[str, float]:
    """The rig's values under the model's addresses [SI]."""
    by_name = {f"{spelt(key, made.truth)}.": key for key in made.hidden}
    found = {}
    for name in model.parameters:
        key = next((key for start, key in by_name.items() if name.startswith(start)), None)
        address = name if key is None else address_of(name, spelt(key, made.truth), key)
        if address in made.truth:
            found[name] = made.truth[address]
    for effect in model.effects:
        if isinstance(effect, ThermalDerating) and (name := f"{effect.key}.coefficient") in found:
            own = next(a.reference for a in RIGS[made.rig].actuators if a.name == effect.target)
            found[name] *= (effect.reference / own) ** 2
    return found
