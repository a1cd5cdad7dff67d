"""A learning rate falls in a line, over the frames that were learnt from, and goes on falling after a checkpoint."""

from __future__ import annotations

import copy

import pytest

from onlinebayes.objectives import (
    ActorCriticSettings,
    DDPGSettings,
    PPOSettings,
    SACSettings,
    actor_critic,
    ddpg,
    ppo,
    sac,
)
from onlinebayes.objectives.testing import check_acts
from onlinebayes.runs import BadInput
from tests.objectives.test_conformance import pendulums, specs, with_memory

SMALL = {"minibatch": 16, "anneal_frames": 256, "learning_rate": 1e-3}
BUILT = {
    "ppo": (pendulums, ppo, PPOSettings(epochs=1, **SMALL)),
    "sac": (pendulums, sac, SACSettings(frames_per_update=32, **SMALL)),
    "ddpg": (pendulums, ddpg, DDPGSettings(widths=(8,), frames_per_update=32, **SMALL)),
    "actor_critic": (with_memory, actor_critic, ActorCriticSettings(width=8, anneal_frames=256)),
}


@pytest.mark.parametrize("kind", BUILT)
def test_it_falls_with_the_frames_and_ends_at_zero(kind: str) -> None:
    make_env, build, settings = BUILT[kind]
    objective = build(*specs(make_env), settings)
    data = check_acts(objective, make_env())
    objective.update(data)
    half = 1 - data.numel() / 256
    assert 0 < half < 1
    assert [group["lr"] for group in objective.optimiser.param_groups] == [pytest.approx(1e-3 * half)]
    again = build(*specs(make_env), settings)
    again.load_state_dict(copy.deepcopy(objective.state_dict()))
    for _ in range(256 // data.numel()):
        again.update(data)
    assert again.optimiser.param_groups[0]["lr"] == pytest.approx(0.0, abs=1e-12)


def test_it_stays_where_nothing_is_said() -> None:
    objective = sac(*specs(pendulums), SACSettings(minibatch=16, frames_per_update=32))
    objective.update(check_acts(objective, pendulums()))
    assert objective.optimiser.param_groups[0]["lr"] == 1e-3


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(BadInput, match="anneal_frames = 0: it must be a whole number, one or more"):
        SACSettings(anneal_frames=0)
    with pytest.raises(BadInput, match=r"anneal_frames = 100 beside target_kl = 0\.02; give one"):
        PPOSettings(anneal_frames=100, target_kl=0.02)
