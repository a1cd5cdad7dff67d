"""What networks see: one key or several, normalised or not, and one clear line where they do not fit."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Bounded, Categorical, Composite, OneHot, Unbounded
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.objectives import (
    ActorCriticSettings,
    DDPGSettings,
    PPOSettings,
    SACSettings,
    action_value,
    actor_critic,
    ddpg,
    inputs_of,
    ppo,
    sac,
    state_value,
    stochastic_policy,
)
from onlinebayes.runs import BadInput

KEYS = ("observation", ("embedding", "vector"))
SPEC = Composite(observation=Unbounded((3,)), embedding=Composite(vector=Unbounded((2,), dtype=torch.float64)))
ACTION = Bounded(torch.tensor([-2.0, 0.0]), torch.tensor([2.0, 1.0]))
BUILDERS = pytest.mark.parametrize(
    ("build", "settings"), [(ppo, PPOSettings(minibatch=32)), (sac, SACSettings(minibatch=32))]
)


def observed(n: int, t: int, offset: float = 0.0) -> dict:
    return {
        "observation": torch.randn(n, t, 3) + offset,
        "embedding": {"vector": torch.randn(n, t, 2, dtype=torch.float64)},
    }


def batch(policy, n: int = 8, t: int = 16, offset: float = 0.0) -> TensorDict:
    """What a collector gives."""
    with set_exploration_type(ExplorationType.RANDOM):
        data = policy(TensorDict(observed(n, t, offset), (n, t))).detach()
    done = torch.zeros(n, t, 1, dtype=torch.bool)
    done[:, -1] = True
    ends = {"reward": torch.randn(n, t, 1), "done": done, "terminated": done.clone()}
    return data.update({"next": {**observed(n, t, offset), **ends}})


def test_several_keys_are_one_row_in_their_order():
    data = TensorDict(observed(4, 5), (4, 5))
    row = inputs_of(SPEC, KEYS).read(data)
    assert row.dtype == torch.float32
    torch.testing.assert_close(row[..., :3], data["observation"])
    torch.testing.assert_close(row[..., 3:], data["embedding", "vector"].float())
    turned = inputs_of(SPEC, KEYS[::-1]).read(data)
    torch.testing.assert_close(turned, row[..., [3, 4, 0, 1, 2]])


@pytest.mark.parametrize("build", [stochastic_policy, action_value])
def test_networks_read_their_keys_alone(build):
    network = build(SPEC, ACTION, in_keys=[("embedding", "vector")])
    data = TensorDict({**observed(4, 1), "action": torch.rand(4, 1, 2)}, (4, 1))
    other = data.clone().set("observation", torch.randn(4, 1, 3))
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        out, same = network(data), network(other)
    key = network.out_keys[-1]
    assert torch.equal(out[key], same[key])


def test_a_leaf_goes_by_the_name_of_its_one_key():
    value = state_value(Unbounded((2,)), in_keys=[("embedding", "vector")])
    assert value(TensorDict(observed(4, 1), (4, 1)))["state_value"].shape == (4, 1, 1)


@BUILDERS
def test_objectives_learn_from_several_keys(build, settings):
    objective = build(SPEC, ACTION, settings, in_keys=KEYS)
    before = {name: value.clone() for name, value in objective.loss.named_parameters()}
    assert all(torch.isfinite(torch.tensor(value)) for value in objective.update(batch(objective.policy)).values())
    learnt = dict(objective.loss.named_parameters())
    still = [name for name, value in before.items() if learnt[name].requires_grad and torch.equal(learnt[name], value)]
    assert not still, f"no gradient reached {still}"


@BUILDERS
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_specs_of_either_precision_serve(build, settings, dtype):
    action = Bounded(-1, 1, (2,), dtype=dtype)
    objective = build(Unbounded((3,), dtype=dtype), action, settings)
    data = batch(objective.policy).apply(lambda x: x.to(dtype) if x.is_floating_point() else x)
    assert all(torch.isfinite(torch.tensor(value)) for value in objective.update(data).values())


@BUILDERS
def test_normalisation_follows_what_is_learnt_from_and_stands_still_else(build, settings):
    objective = build(SPEC, ACTION, replace(settings, normalise=True), in_keys=KEYS)
    normalisation = objective.inputs.normalisation
    data = batch(objective.policy, offset=100.0)
    assert normalisation.count == 0
    objective.update(data)
    assert normalisation.count == data.numel()
    torch.testing.assert_close(normalisation.mean[:3], data["observation"].mean((0, 1)))
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        objective.policy(TensorDict(observed(2, 2), (2, 2)))
    assert normalisation.count == data.numel()
    row = objective.inputs.read(data)
    torch.testing.assert_close(row.mean((0, 1)), torch.zeros(5), atol=1e-3, rtol=0)


def test_ppo_with_normalisation_starts_from_ratios_of_one():
    # The statistics move before it learns; what moves the policy is the gradient alone.
    settings = PPOSettings(minibatch=128, epochs=1, normalise=True)
    objective = ppo(SPEC, ACTION, settings, in_keys=KEYS)
    assert abs(objective.update(batch(objective.policy, offset=100.0))["kl_approx"]) < 1e-5


@BUILDERS
@pytest.mark.parametrize("normalise", [False, True])
def test_it_goes_on_bit_for_bit(build, settings, normalise, tmp_path):
    def fresh():
        return build(SPEC, ACTION, replace(settings, normalise=normalise), in_keys=KEYS)

    def learnt(objective):
        for _ in range(3):
            objective.update(batch(objective.policy, offset=5.0))
        return objective

    first = learnt(fresh())
    torch.save(first.state_dict(), tmp_path / "state.pt")
    second = fresh()
    second.load_state_dict(torch.load(tmp_path / "state.pt", weights_only=True))
    for objective in (first, second):
        torch.manual_seed(1)
        learnt(objective)
    for name in ("loss", "policy"):
        states = [getattr(objective, name).state_dict() for objective in (first, second)]
        for key, value in states[0].items():
            if isinstance(value, torch.Tensor):
                assert torch.equal(value, states[1][key]), key
    if normalise:
        pairs = zip(first.inputs.normalisation.buffers(), second.inputs.normalisation.buffers(), strict=True)
        assert all(torch.equal(a, b) for a, b in pairs)


@pytest.mark.parametrize(
    ("build", "settings"),
    [(ppo, PPOSettings), (sac, SACSettings), (ddpg, DDPGSettings), (actor_critic, ActorCriticSettings)],
)
@pytest.mark.parametrize("normalise", [False, True])
def test_a_state_with_other_statistics_than_the_networks_have_is_refused(build, settings, normalise):
    saved = build(Unbounded((3,)), ACTION, settings(normalise=normalise)).state_dict()
    with pytest.raises(BadInput, match=r"does not fit this run: only .* has .*normalisation"):
        build(Unbounded((3,)), ACTION, settings(normalise=not normalise)).load_state_dict(saved)


@BUILDERS
def test_a_batch_that_does_not_fit_is_refused_in_one_line(build, settings):
    objective = build(SPEC, ACTION, settings, in_keys=KEYS)
    data = batch(objective.policy)
    for missing in (("embedding", "vector"), "action", ("next", "reward"), ("next", "observation")):
        with pytest.raises(BadInput, match="the batch has no"):
            objective.update(data.exclude(missing))
    wide = data.clone()
    wide["embedding", "vector"] = torch.randn(8, 16, 5)
    with pytest.raises(BadInput, match="5 wide, the policy was built for 2"):
        objective.update(wide)


@pytest.mark.parametrize("build", [ppo, sac, actor_critic])
def test_specs_that_nobody_supports_are_refused(build):
    with pytest.raises(BadInput, match="action spec of type Unbounded"):
        build(SPEC, Unbounded((2,)), in_keys=KEYS)
    with pytest.raises(BadInput, match="one world"):
        build(SPEC, Bounded(-1, 1, (4, 2)), in_keys=KEYS)
    with pytest.raises(BadInput, match="in_keys has 'pixels', the observation spec has"):
        build(SPEC, ACTION, in_keys=["observation", "pixels"])
    with pytest.raises(BadInput, match="Composite"):
        build(Unbounded((3,)), ACTION, in_keys=KEYS)
    with pytest.raises(BadInput, match="observation_spec_unbatched"):
        build(Composite(observation=Unbounded((16, 3)), shape=(16,)), ACTION)


def test_sac_refuses_what_is_not_bounded():
    for spec in (Categorical(3), OneHot(3)):
        with pytest.raises(BadInput, match="Bounded"):
            sac(SPEC, spec)
