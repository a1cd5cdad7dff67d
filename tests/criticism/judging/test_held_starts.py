"""A held-out error that the starts make is told from one that the model makes."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism import Criticism, compare
from onlinebayes.criticism.judging.held_starts import fitted_starts, left_with_fitted_starts, starts_note
from onlinebayes.criticism.report.json import to_dict
from onlinebayes.criticism.report.phrases import effects_in_words
from onlinebayes.criticism.report.words import improvement
from onlinebayes.criticism.results import HeldOutError
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.replaying.measured_starts import windows_to_replay
from tests.criticism.rigs import measure, model

HELD = ["run3"]


@pytest.fixture(scope="module")
def compared() -> Criticism:
    return compare(model(), measure(runs=4), holdout=HELD)


@pytest.fixture(scope="module")
def held(compared: Criticism) -> Windows:
    noise = torch.tensor([compared.sensor_sd[name] for name in compared.signals]).double()
    return windows_to_replay(compared.final.simulator, measure(runs=4).select(HELD), compared.final.theta, 1.0, noise)


def rough(held: Windows) -> Windows:
    """Starts that are ten standard deviations off."""
    return replace(held, start=held.start + 10 * held.start_sd)


def tenfold(error: HeldOutError) -> HeldOutError:
    return replace(error, after={name: 10 * floor for name, floor in error.noise_floor.items()})


def test_starts_that_are_off_leave_noise_once_they_are_fitted(compared: Criticism, held: Windows) -> None:
    theta = compared.final.theta
    assert float(left_with_fitted_starts(compared.final.simulator, rough(held), theta).max()) < 1.2
    assert float(left_with_fitted_starts(compared.final.simulator, held, 0.5 * theta).max()) > 3


def test_only_an_error_of_the_starts_is_called_so(compared: Criticism, held: Windows) -> None:
    error = compared.heldout_error
    (name,) = compared.signals
    assert fitted_starts(compared.final, rough(held), error, 1.2) == {}
    left = fitted_starts(compared.final, rough(held), tenfold(error), 1.2)
    assert list(left) == [name]
    assert left[name] < 1.2
    wrong = replace(compared.final, theta=0.5 * compared.final.theta)
    assert fitted_starts(wrong, held, tenfold(error), 1.2) == {}


def test_the_note_names_the_signals_and_what_fitted_starts_leave(compared: Criticism) -> None:
    (name,) = compared.signals
    error = tenfold(compared.heldout_error)
    assert starts_note({}, error) == ()
    (note,) = starts_note({name: 1.04}, error)
    assert note.startswith(f"the held-out error of {name} is 10 times what noise explains because its windows start")
    assert note.endswith("with the starts fitted, 1.0 times the sensor noise is left")


def test_the_sentence_does_not_contradict_the_remainder(compared: Criticism) -> None:
    """Far above its floor and yet noise: it says that the starts make up the rest, and report.json stays as it is."""
    (name,) = compared.signals
    errors = tenfold(compared.heldout_error)
    result = replace(compared, heldout_error=errors, fitted_starts={name: 1.04})
    assert improvement(result).endswith(
        ", the uncertain starts of the windows the rest: with those fitted, 1.0 times the sensor noise is left."
    )
    assert "starts" not in improvement(replace(result, fitted_starts={}))
    assert "fitted_starts" not in to_dict(result)


def test_signals_without_rows_or_floor_and_replays_that_diverged_have_no_note(
    compared: Criticism, held: Windows
) -> None:
    (name,) = compared.signals
    for after, floor in ((math.nan, 1.0), (1.0, 0.0), (math.inf, 1.0)):
        error = replace(compared.heldout_error, after={name: after}, noise_floor={name: floor})
        assert fitted_starts(compared.final, rough(held), error, 1.2) == {}


def test_effects_that_several_targets_share_are_said_once() -> None:
    lags = ["actuator_lag@rotor2", "actuator_lag@rotor1", "actuator_lag@rotor3"]
    assert effects_in_words(lags) == "actuator lag at rotor1, rotor2 and rotor3"
    assert effects_in_words(["dry_friction@a", "constant_load@a", "actuator_delay@m"]) == (
        "dry friction and constant load at a, and actuator delay at m"
    )
    assert effects_in_words(["back_emf@m", "viscous_friction@a"], "or") == "back-EMF at m, or viscous friction at a"
    assert effects_in_words(["own"]) == "own"
