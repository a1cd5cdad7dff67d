"""The reliability study: what is learnt is what made the cases, and what only looks like the truth is wrong."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch

import onlinebayes.criticism.findings.named as named_module
from onlinebayes.criticism import Named, evidence, probability
from recipes.studies import reliability
from recipes.studies.blind_rigs.record import Judged
from recipes.studies.reliability import in_machine, learn, logistic, statements, tabulate

COEFFICIENTS = (1.5, -1.0, 1.0, 0.5, 0.3, -0.5, 0.6)


def said(draw: torch.Generator) -> Named:
    left, certain, large, place, away = torch.rand(5, generator=draw).tolist()
    gain = 0.1 * 30**large
    return Named("a@x", (), (1.0,), gain, gain / 100**certain, gain, int(3 * place), 10**left, 30**away)


@pytest.fixture
def learnt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    file = tmp_path / "learnt.json"
    monkeypatch.setattr(named_module, "LEARNT", file)
    monkeypatch.setattr(reliability, "LEARNT", file)
    named_module.learnt.cache_clear()
    yield file
    named_module.learnt.cache_clear()


def cases(count: int, draw: torch.Generator) -> list[Judged]:
    """One statement a case, in the machine as often as the coefficients say; intervals half as wide as they should."""
    found = []
    for k in range(count):
        one = said(draw)
        p = 1 / (1 + math.exp(-sum(b * x for b, x in zip(COEFFICIENTS, evidence(one), strict=True))))
        hidden = "a@x" if float(torch.rand(1, generator=draw)) < p else "b@x"
        off = 2 * float(torch.randn(1, generator=draw)) / 1.645
        fields = json.loads(json.dumps(asdict(one)))
        found.append(Judged("swing", "effect", k, hidden=(hidden,), named=(fields,), deviations={"mass": off}))
    return found


def test_what_is_learnt_is_what_made_the_cases(learnt: Path) -> None:
    """2000 cases: errors of .05 and of a factor of 1.15 are beyond four standard errors."""
    learn(cases(2000, torch.Generator().manual_seed(1)))
    others = cases(2000, torch.Generator().manual_seed(2))
    table = {row.name: row for row in tabulate(others, "a test").rows}
    assert table["calibration error"].value < 0.05
    assert abs(json.loads(learnt.read_text())["factor"] / 2 - 1) < 0.15
    draw = torch.Generator().manual_seed(3)
    for one in (said(draw) for _ in range(50)):
        true = 1 / (1 + math.exp(-sum(b * x for b, x in zip(COEFFICIENTS, evidence(one), strict=True))))
        assert abs(probability(one) - true) < 0.1


def test_coefficients_are_finite_where_all_are_right() -> None:
    x = torch.cat([torch.ones(30, 1), torch.rand(30, 2)], dim=1).double()
    found = logistic(x, torch.ones(30).double())
    assert bool(torch.isfinite(found).all())
    assert bool((torch.sigmoid(x @ found) > 0.9).all())


@pytest.mark.parametrize(
    ("rig", "hidden", "name", "right"),
    [
        ("swing", "dry_friction@hinge", "dry_friction@hinge", True),
        ("swing", "joint.hinge.damping", "viscous_friction@hinge", True),
        ("swing", "asymmetric_friction@hinge", "constant_load@hinge", True),
        ("swing", "gravity_tilt@world.x", "com_offset@bob.x", False),
        ("swing", "dry_friction@hinge", "backlash@hinge", False),
    ],
)
def test_what_only_looks_like_it_is_wrong(rig: str, hidden: str, name: str, right: bool) -> None:
    assert in_machine(rig, [hidden], name) is right


def test_equals_are_one_statement() -> None:
    fields = asdict(Named("com_offset@bob.x", ("gravity_tilt@world.x",), (0.4, 0.6), 1.0, 0.1, 0.9, 0, 1.0))
    judged = Judged("swing", "tie", 1, hidden=("gravity_tilt@world.x",), named=(fields,))
    (one,) = statements(judged)
    assert one.right == (False, True)
    assert statements(Judged("swing", "null", 1)) == []


def test_what_no_case_showed_says_no_more_than_the_farthest_that_one_did(learnt: Path) -> None:
    """A real machine that leaves a thousand times its noise is as probable as a blind one that leaves the most."""
    found = cases(200, torch.Generator().manual_seed(1))
    learn(found)
    most = max(fields["left"] for case in found for fields in case.named)
    one = said(torch.Generator().manual_seed(4))
    assert probability(replace(one, left=1e4)) == pytest.approx(probability(replace(one, left=most)))
    assert probability(replace(one, left=1.0)) > probability(replace(one, left=most))
