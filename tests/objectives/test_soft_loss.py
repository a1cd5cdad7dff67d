"""The lean losses and buffer: the same numbers as TorchRL's, the same batches as one's own eyes."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.data import Bounded, Composite, OneHot, Unbounded
from torchrl.modules import ValueOperator
from torchrl.objectives import SACLoss, ValueEstimators

from onlinebayes.objectives import TransitionBuffer, inputs_of, ppo, sac, stochastic_policy
from onlinebayes.objectives.targets import Follower
from onlinebayes.runs import BadInput

OBSERVATION, ACTION = Unbounded((3,)), Bounded(-2.0, 2.0, (2,), dtype=torch.float32)


def transitions(rows: int = 64) -> TensorDict:
    return TensorDict(
        {
            "observation": torch.randn(rows, 3),
            "action": 3.8 * torch.rand(rows, 2) - 1.9,
            "next": {
                "observation": torch.randn(rows, 3),
                "reward": torch.randn(rows, 1),
                "terminated": torch.rand(rows, 1) < 0.2,
                "done": torch.rand(rows, 1) < 0.2,
            },
        },
        (rows,),
    )


class Critic(nn.Module):
    """One member of an ensemble, as a module of its own."""

    def __init__(self, ensemble, member: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for weight, bias in zip(ensemble.weights, ensemble.biases, strict=True):
            linear = nn.Linear(*weight.shape[1:])
            linear.weight.data.copy_(weight[member].T)
            linear.bias.data.copy_(bias[member, 0])
            layers += [linear, nn.ReLU()]
        self.net = nn.Sequential(*layers[:-1])

    def forward(self, observation, action):
        return self.net(torch.cat([observation, action], -1))


def test_losses_and_gradients_equal_torchrls() -> None:
    ours = sac(OBSERVATION, ACTION, widths=(16, 16), gamma=0.9, alpha=0.5)
    critics = [ValueOperator(Critic(ours.loss.critics, i), in_keys=["observation", "action"]) for i in range(2)]
    theirs = SACLoss(ours.policy, critics, action_spec=ACTION, alpha_init=0.5, loss_function="l2")
    theirs.make_value_estimator(ValueEstimators.TD0, gamma=0.9)
    data = transitions()
    torch.manual_seed(1)
    expected = theirs(data.clone())
    torch.manual_seed(1)
    found = ours.loss(data.clone())
    for name in ours.loss.out_keys:
        a, b = found[name].detach().squeeze(), expected[name].detach().squeeze()
        torch.testing.assert_close(a, b, rtol=1e-6, atol=1e-6, msg=lambda text, name=name: f"{name}: {text}")
    names = ("loss_actor", "loss_qvalue", "loss_alpha")
    sum(found[name] for name in names).backward()
    sum(expected[name].sum() for name in names).backward()
    actor = [weight.grad for weight in theirs.actor_network_params.values(True, True)]
    for weight, grad in zip(ours.loss.actor.parameters(), actor, strict=True):
        torch.testing.assert_close(weight.grad, grad, rtol=1e-6, atol=1e-6)
    stacked = [weight.grad for weight in theirs.qvalue_network_params.values(True, True)]
    mine = [grad for pair in zip(ours.loss.critics.biases, ours.loss.critics.weights, strict=True) for grad in pair]
    by_shape = {tuple(grad.flatten(1).shape): grad for grad in stacked}
    for weight in mine:
        grad = weight.grad.transpose(1, 2) if weight.shape[1] > 1 else weight.grad[:, 0]
        torch.testing.assert_close(
            by_shape[tuple(grad.flatten(1).shape)].reshape(grad.shape), grad, rtol=1e-5, atol=1e-6
        )
    torch.testing.assert_close(ours.loss.log_alpha.grad, theirs.log_alpha.grad.squeeze(), rtol=1e-6, atol=1e-6)


def test_targets_follow_by_tau() -> None:
    network = nn.Linear(2, 2)
    follower = Follower(network, 0.1)
    before = follower.network.weight.clone()
    network.weight.data.add_(1.0)
    follower.step()
    torch.testing.assert_close(follower.network.weight, before + 0.1)
    assert not follower.network.weight.requires_grad
    with pytest.raises(ValueError, match="0 < tau <= 1"):
        Follower(network, 0.0)


def test_a_buffer_keeps_the_last_rows_and_deals_all_of_them() -> None:
    buffer = TransitionBuffer(5)
    with pytest.raises(ValueError, match="empty"):
        buffer.sample(1)
    for k in range(4):
        buffer.extend(TensorDict({"a": torch.tensor([[2.0 * k], [2.0 * k + 1]]), ("b", "c"): torch.zeros(2)}, (2,)))
    assert len(buffer) == 5
    drawn = buffer.sample(500)
    assert sorted(drawn["a"].unique().tolist()) == [3, 4, 5, 6, 7]
    assert drawn["b", "c"].shape == (500,)
    other = TransitionBuffer(5)
    other.load_state_dict(buffer.state_dict())
    for each in (buffer, other):
        each.extend(TensorDict({"a": torch.tensor([[9.0]]), ("b", "c"): torch.ones(1)}, (1,)))
    torch.manual_seed(0)
    first = buffer.sample(50)
    torch.manual_seed(0)
    assert (first == other.sample(50)).all()
    with pytest.raises(ValueError, match="do not fit"):
        TransitionBuffer(3).load_state_dict(buffer.state_dict())


SPECS = Composite(
    observation=Unbounded((3,)),
    embedding=Composite(vector=Unbounded((4,))),
    theta=Unbounded((2,), dtype=torch.float64),
)
KEYS = ["observation", ("embedding", "vector"), "theta"]


def collected(worlds: int = 8, steps: int = 16) -> TensorDict:
    def seen() -> dict:
        return {
            "observation": torch.randn(worlds, steps, 3),
            "embedding": {"vector": 5 + 3 * torch.randn(worlds, steps, 4)},
            "theta": torch.rand(worlds, steps, 2, dtype=torch.float64),
        }

    ends = torch.zeros(worlds, steps, 1, dtype=torch.bool)
    after = {**seen(), "reward": torch.randn(worlds, steps, 1), "done": ends, "terminated": ends}
    return TensorDict({**seen(), "next": after}, (worlds, steps))


@pytest.mark.parametrize("build", [ppo, sac])
@pytest.mark.parametrize("normalise", [False, True])
def test_policies_see_several_keys_joined(build, normalise: bool) -> None:
    objective = build(SPECS, ACTION, in_keys=KEYS, normalise=normalise, minibatch=32)
    data = collected()
    objective.policy(data)
    losses = objective.update(data)
    assert all(torch.isfinite(torch.tensor(value)) for value in losses.values())
    if normalise:
        mean = objective.inputs.normalisation.mean
        torch.testing.assert_close(mean[3:7], data["embedding", "vector"].flatten(0, 1).mean(0), rtol=1e-4, atol=1e-4)
        before = mean.clone()
        objective.policy(collected())
        assert torch.equal(before, objective.inputs.normalisation.mean), "acting is not learning"


def test_wrong_keys_and_widths_are_told_in_one_line() -> None:
    with pytest.raises(BadInput, match="in_keys has 'speed'"):
        inputs_of(SPECS, ["speed"])
    with pytest.raises(BadInput, match="spec of one leaf"):
        inputs_of(OBSERVATION, ["a", "b"])
    objective = sac(SPECS, ACTION, in_keys=KEYS)
    data = collected()
    objective.policy(data)
    with pytest.raises(BadInput, match="the batch has no"):
        objective.update(data.exclude("theta"))
    data["observation"] = torch.randn(8, 16, 5)
    with pytest.raises(BadInput, match="is 5 wide, the policy was built for 3"):
        objective.update(data)
    with pytest.raises(BadInput, match="OneHot"):
        sac(OBSERVATION, OneHot(3))
    with pytest.raises(BadInput, match="give the leaf spec of one world"):
        stochastic_policy(OBSERVATION, Unbounded((2,)))
    assert isinstance(objective.policy[0], TensorDictModule)
