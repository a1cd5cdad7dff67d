"""What a run's page says of its steps."""

from __future__ import annotations

import math
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest

from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import ParameterSpace
from onlinebayes.trainers.provenance import made_by
from onlinebayes.trainers.run_page import notes_of, quantiles_of
from onlinebayes.trainers.state import Record, described


def record(step: int, *notes: str) -> Record:
    return Record(step, 0, 0, {}, {}, notes=notes)


def test_notes_that_differ_by_their_numbers_alone_are_one_line() -> None:
    records = [
        record(1, "narrowed to 98.9 % of the prior: 45 of 48 inside", "learnt nothing (loss -0.01 nats)"),
        record(2, "narrowed to 97 % of the prior: 47 of 48 inside"),
        record(3, "learnt nothing (loss 1e-05 nats)"),
        record(4, "learnt nothing (loss 0.02 nats)", "the real system failed"),
    ]
    assert notes_of(records) == [
        "steps 1 to 2: narrowed to 97 % of the prior: 47 of 48 inside",
        "steps 1, 3 to 4: learnt nothing (loss 0.02 nats)",
        "step 4: the real system failed",
    ]
    assert notes_of([]) == []


def test_a_run_that_kept_mean_and_sd_alone_shows_the_quantiles_of_a_normal_distribution() -> None:
    old = replace(record(1), belief={"mass": (2.0, 0.1)})
    assert quantiles_of(old, "mass") == pytest.approx((1.8355, 2.0, 2.1645))
    new = replace(old, quantiles={"mass": (1.9, 2.0, 2.3)})
    assert quantiles_of(new, "mass") == (1.9, 2.0, 2.3)
    assert all(math.isnan(value) for value in quantiles_of(old, "one that the model got later"))


def test_the_page_says_how_the_run_was_made(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"settings": {"seed": 3, "short": true}, "objective": {"gamma": 0.98}}')
    said = made_by(tmp_path)
    assert (said["settings"], said["objective"]) == ("seed 3, short True", "gamma 0.98")
    assert f"torch {version('torch')}" in said["versions"]
    assert {"date", "command"} <= said.keys()
    assert "settings" not in made_by(tmp_path / "none")


def test_a_belief_about_no_parameter_has_no_moments_and_no_quantiles() -> None:
    nothing = BoxUniform(ParameterSpace())
    assert described(nothing) == ({}, {})
