"""The alarm keeps quiet on what the simulator made, and rings on what it cannot make."""

from __future__ import annotations

import pytest
import torch
from scipy.stats import kstest

from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import Alarm
from onlinebayes.runs import BadInput
from tests.inference.test_protocol import PRIOR, simulate


@pytest.fixture(scope="module")
def alarm() -> Alarm:
    generator = torch.Generator().manual_seed(0)
    simulations = simulate(PRIOR.sample((1500,), generator), generator)
    embedding = SummaryEmbedding(TransitionFeatures(2, 1)).double()
    steps = torch.ones(1500, 4, dtype=torch.bool)
    values = (simulations["observation"], simulations["action"], simulations["next", "observation"])
    embedding.fit(*values, steps)
    return Alarm(embedding, simulations)


def test_it_rings_as_often_as_it_says_on_what_the_simulator_made(alarm: Alarm) -> None:
    generator = torch.Generator().manual_seed(1)
    fresh = simulate(PRIOR.sample((300,), generator), generator)
    p = torch.tensor([alarm.check(fresh[k : k + 1]).p for k in range(300)])
    # Uniform to a step of 1/1501; a seed in a thousand would fail, and the seed is fixed.
    assert kstest(p.numpy(), "uniform").pvalue > 1e-3
    assert float((p < 0.05).double().mean()) < 0.09  # three standard errors of 300


def test_it_rings_on_what_the_simulator_cannot_make(alarm: Alarm) -> None:
    generator = torch.Generator().manual_seed(2)
    strange = simulate(PRIOR.sample((6,), generator), generator)
    strange["next", "observation"] = strange["next", "observation"] + 3.0
    found = alarm.check(strange)
    assert found
    assert found.p < 0.01
    assert abs(float(found.away[found.farthest[0]])) > 5
    far = simulate(PRIOR.sample((1,), generator), generator)
    far["observation"], far["next", "observation"] = 1000 * far["observation"], 1000 * far["next", "observation"]
    assert alarm.check(far)


def test_each_is_one_by_one(alarm: Alarm) -> None:
    generator = torch.Generator().manual_seed(4)
    some = simulate(PRIOR.sample((5,), generator), generator)
    assert [found.p for found in alarm.each(some)] == [alarm.check(some[k : k + 1]).p for k in range(5)]


def test_several_trajectories_do_not_make_it_ring_more_often(alarm: Alarm) -> None:
    generator = torch.Generator().manual_seed(3)
    way = 0
    for theta in PRIOR.sample((100,), generator):
        way += bool(alarm.check(simulate(theta.expand(6, -1), generator)))
    assert way <= 12  # five in a hundred expected at most; three standard errors more


def test_few_simulations_are_refused() -> None:
    generator = torch.Generator().manual_seed(0)
    with pytest.raises(BadInput, match="99 simulations"):
        Alarm(SummaryEmbedding(TransitionFeatures(2, 1)), simulate(PRIOR.sample((99,), generator), generator))
