"""A run whose machine may change: what is asked anew, what is kept, what is said."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from onlinebayes.inference import BoxUniform, ChangingBelief, FitReport, Hazard, TruncatedMixture
from onlinebayes.runs import BadInput
from onlinebayes.runs.checkpoints import plain
from onlinebayes.trainers import Follower, OnlineState
from onlinebayes.trainers.following import Learnt, from_plain, news, to_plain
from tests.inference.test_run_length import SPACE, Exact, noisy
from tests.trainers.test_online import PRIOR, build

LEARNT = Learnt(Exact(), FitReport(), noisy([0.3], 0), noisy([0.3], 0))
FOLLOWER = Follower(BoxUniform(SPACE), Hazard())


def test_what_is_new_is_followed_and_said() -> None:
    data = noisy([0.3] * 3 + [0.8] * 3, 2)
    belief, history = FOLLOWER.belief(LEARNT, None, data[:3])
    assert news(None, history) == []
    after, changed = FOLLOWER.belief(LEARNT, history, data)
    assert "the machine changed after trajectory 3" in news(history, changed)[0]
    assert news(changed, changed) == []
    assert isinstance(belief, TruncatedMixture)
    assert isinstance(after, TruncatedMixture)
    assert abs(float(after.sample((500,), torch.Generator().manual_seed(0)).mean()) - 1.6) < 0.1


def test_an_effect_that_the_model_lacks_is_said() -> None:
    history = ChangingBelief(Exact()).update(noisy([0.3] * 4, 3)).history
    assert "lacks an effect" in news(history, replace(history, novelty=(0.01,) * 4))[0]


def test_a_history_survives_a_checkpoint() -> None:
    history = ChangingBelief(Exact(), Hazard(together=2)).update(noisy([0.3] * 3 + [0.7] * 2, 4)).history
    history = replace(history, novelty=(0.5, 0.25))
    back = from_plain(SPACE, to_plain(history))
    assert back is not None
    assert (back.changes, back.novelty, back.in_words()) == (history.changes, history.novelty, history.in_words())
    assert back.lengths.hazard == history.lengths.hazard
    for one, other in zip(back.lengths.runs, history.lengths.runs, strict=True):
        assert (one.since, one.unread, one.log_weight) == (other.since, other.unread, other.log_weight)
        assert (one.start is None) == (other.start is None)
        assert one.start is None or torch.equal(one.start.mean, other.start.mean)
    assert to_plain(None) is None
    assert from_plain(SPACE, None) is None


def test_a_run_keeps_its_history() -> None:
    trainer = build(hazard=Hazard(), simulations=120)
    state = trainer.run(OnlineState.begin(PRIOR))
    assert state.history is not None
    assert state.history.lengths.number == len(state.real) == 2
    assert len(state.history.novelty) == 2
    assert state.proposal is PRIOR, "the next machine may lie anywhere"
    saved = plain(state.state_dict())
    again = OnlineState.begin(PRIOR)
    again.load_state_dict(saved)
    assert again.history is not None
    assert again.history.in_words() == state.history.in_words()
    assert [run.since for run in again.history.lengths.runs] == [run.since for run in state.history.lengths.runs]


def test_without_a_hazard_nothing_is_followed() -> None:
    state = build(steps=1).run(OnlineState.begin(PRIOR))
    assert state.history is None


def test_a_prior_that_is_not_uniform_is_refused() -> None:
    with pytest.raises(BadInput, match="give a BoxUniform, or leave the hazard out"):
        Follower(Exact().condition(noisy([0.3], 5)), Hazard())


def test_a_gate_that_narrows_is_refused() -> None:
    with pytest.raises(BadInput, match="the next machine may lie anywhere"):
        replace(build(), follower=FOLLOWER)
