"""The exclusion limit of an effect: by hand for one column, and which of several columns it is taken from."""

from __future__ import annotations

import math

import pytest
import torch

from onlinebayes.criticism.candidates.candidates import Trial
from onlinebayes.criticism.candidates.exclusion import exclusion_limit
from onlinebayes.criticism.judging.screening import Scores
from onlinebayes.identification.fitting.blocks import t_quantile
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorSaturation, DryFriction, JointStiffness

GROUPS = 8
SEEN = math.sqrt(1 / 0.95**2 - 1)
SPRING = JointStiffness("hinge", Parameter(0.0, 4.0, "N m/rad"), Parameter(-1.0, 1.0, "rad"))
FRICTION = DryFriction("hinge", Parameter(0.0, 4.0, "N m"))


def _scores(norms: list[float], g: torch.Tensor | None = None, share: list[float] | None = None) -> Scores:
    """Columns of these squared lengths, in units of their reach, before a residual of length 1."""
    norm = torch.tensor(norms)
    g = torch.zeros(GROUPS, len(norms)) if g is None else g
    return Scores(
        g=g,
        h=torch.zeros(GROUPS, 0, len(norms)),
        norm=norm,
        share=torch.ones(len(norms)) if share is None else torch.tensor(share),
        scale=1.0,
        misfit=1.0,
        size=g.sum(0) / norm,
        loads=torch.zeros(0, len(norms)),
    )


def _spring(stiffness: float, rest: float) -> Trial:
    return Trial(0, {"stiffness": stiffness, "springref": rest}, False, stiffness)


def _friction(size: float) -> Trial:
    return Trial(0, {FRICTION.magnitude: size}, False, size)


def test_what_lowers_the_error_by_a_twentieth_is_seen() -> None:
    limit = exclusion_limit(_scores([4.0]), GROUPS, FRICTION, [0], [_friction(0.5)])
    assert limit == pytest.approx(0.5 * SEEN / 2)


def test_what_is_there_without_the_effect_and_its_spread_count() -> None:
    # A size of -0.5, the same in all groups: an effect makes up for it before anything is seen.
    same = torch.full((GROUPS, 1), -0.25)
    assert exclusion_limit(_scores([4.0], same), GROUPS, FRICTION, [0], [_friction(0.5)]) == pytest.approx(
        0.5 * (0.5 + SEEN / 2)
    )
    # Groups that contradict each other leave more possible than the twentieth.
    apart = torch.tensor([2.0, -2.0] * (GROUPS // 2))[:, None]
    spread = math.sqrt(GROUPS / (GROUPS - 1) * GROUPS * 4.0) / 4.0
    assert exclusion_limit(_scores([4.0], apart), GROUPS, FRICTION, [0], [_friction(0.5)]) == pytest.approx(
        0.5 * t_quantile(0.975, GROUPS) * spread
    )


def test_it_is_that_of_the_values_at_which_least_is_seen() -> None:
    trials = [_spring(0.1, 0.0), _spring(0.1, -0.5), _spring(0.1, 0.5)]
    limit = exclusion_limit(_scores([1.0, 100.0, 64.0]), GROUPS, SPRING, [0, 1, 2], trials)
    assert limit == pytest.approx(0.1 * SEEN)
    # Only its own columns.
    assert exclusion_limit(_scores([1.0, 100.0, 64.0]), GROUPS, SPRING, [1, 2], trials) == pytest.approx(0.1 * SEEN / 8)


def test_of_several_sizes_the_one_next_to_the_limit_tells_it() -> None:
    # The larger ones stick: a hundred times the size does not move the replay a hundred times as far.
    trials = [_friction(0.04), _friction(0.4), _friction(4.0)]
    limit = exclusion_limit(_scores([0.1, 4.0, 9.0]), GROUPS, FRICTION, [0, 1, 2], trials)
    assert limit == pytest.approx(0.04 * SEEN / math.sqrt(0.1))


@pytest.mark.parametrize(
    ("norms", "share"), [([1e-4, 100.0], [1.0, 1.0]), ([1.0, 100.0], [1e-4, 1.0]), ([0.0, 100.0], [1.0, 1.0])]
)
def test_none_where_some_of_its_values_show_nothing(norms: list[float], share: list[float]) -> None:
    scores = _scores(norms, share=share)
    assert exclusion_limit(scores, GROUPS, SPRING, [0, 1], [_spring(0.2, 0.0), _spring(0.2, 0.5)]) is None


def test_none_of_a_limit_that_shrinks() -> None:
    effect = ActuatorSaturation("motor", Parameter(0.1, 2.0, "N"))
    trials = [Trial(0, {"limit": 1.5}, False, -0.5)]
    assert exclusion_limit(_scores([4.0]), GROUPS, effect, [0], trials) is None
    assert exclusion_limit(_scores([4.0]), 1, FRICTION, [0], [_friction(0.5)]) is None
