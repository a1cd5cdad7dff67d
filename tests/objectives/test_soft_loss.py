"""The losses of SAC are TorchRL's, without its bookkeeping; the buffer is a ring."""

from __future__ import annotations

import copy

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.modules import ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import SACLoss, SoftUpdate

from onlinebayes.objectives import EnsembleMLP, Follower, SACSettings, TransitionBuffer, sac
from onlinebayes.runs import BadInput

LOW, HIGH = torch.tensor([-2.0, 0.0]), torch.tensor([2.0, 1.0])
SPEC = Composite(observation=Unbounded((3,)), goal=Unbounded((2,)))
KEYS = ("observation", "goal")


def transitions(n: int = 32) -> TensorDict:
    terminated = torch.rand(n, 1) < 0.3
    following = {"observation": torch.randn(n, 3), "goal": torch.randn(n, 2)}
    told = {
        "observation": torch.randn(n, 3),
        "goal": torch.randn(n, 2),
        "action": LOW + (HIGH - LOW) * torch.rand(n, 2),
    }
    ends = {"reward": torch.randn(n, 1), "terminated": terminated, "done": terminated.clone()}
    return TensorDict({**told, "next": {**following, **ends}}, (n,))


class Body(nn.Module):
    """A body on the joined inputs, with the library's normalisation, in double precision."""

    def __init__(self, inputs, body):
        super().__init__()
        self.inputs, self.body = inputs, body

    def forward(self, observation, goal, *action):
        row = self.inputs(observation, goal).double()
        return self.body(torch.cat([row, *action], -1))


def member(critics: EnsembleMLP, k: int) -> nn.Sequential:
    """Critic k as plain layers."""
    layers = []
    for weight, bias in zip(critics.weights, critics.biases, strict=True):
        linear = nn.Linear(weight.shape[1], weight.shape[2], dtype=torch.float64)
        linear.weight.data.copy_(weight[k].T)
        linear.bias.data.copy_(bias[k, 0])
        layers += [linear, nn.ReLU()]
    return nn.Sequential(*layers[:-1])


@pytest.mark.parametrize("normalise", [False, True])
def test_losses_and_gradients_are_torchrls(normalise, monkeypatch):
    settings = SACSettings(widths=(16, 16), gamma=0.9, alpha=0.4, normalise=normalise)
    objective = sac(SPEC, Bounded(LOW, HIGH), settings, in_keys=KEYS)
    loss = objective.loss.double()
    inputs, critics, targets = loss.inputs, loss.critics, loss.targets
    for weight in targets.parameters():
        weight.add_(0.1 * torch.randn_like(weight))
    if normalise:
        inputs.observe(transitions(100))
    data = transitions().apply(lambda x: x.double() if x.is_floating_point() else x)
    data = data.apply(lambda x: x.float().double() if x.is_floating_point() else x)  # inputs are in single precision

    policy = ProbabilisticActor(
        TensorDictModule(Body(inputs, copy.deepcopy(loss.actor)), list(KEYS), ["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        distribution_kwargs={"low": LOW.double(), "high": HIGH.double(), "tanh_loc": False},
        return_log_prob=True,
    )
    values = [ValueOperator(Body(inputs, member(critics, k)), in_keys=[*KEYS, "action"]) for k in range(2)]
    theirs = SACLoss(
        policy,
        values,
        num_qvalue_nets=2,
        loss_function="l2",
        alpha_init=0.4,
        target_entropy=loss.target_entropy,
        delay_qvalue=True,
    )
    theirs.make_value_estimator(gamma=0.9)
    SoftUpdate(theirs, tau=0.05)
    aimed = [member(targets, k) for k in range(2)]
    for name in dict(aimed[0].named_parameters()):
        both = torch.stack([net.get_parameter(name).data for net in aimed])
        theirs.target_qvalue_network_params["module", "body", *name.split(".")].data.copy_(both)

    # The order of draws differs: every draw is the same one.
    noise = torch.randn(32, 2, dtype=torch.float64)
    monkeypatch.setattr(torch, "randn_like", lambda x, **_: noise)
    monkeypatch.setattr(torch.distributions.normal, "_standard_normal", lambda *_, **__: noise)
    told = ("loss_actor", "loss_qvalue", "loss_alpha", "entropy")
    values = loss.losses(
        inputs.read(data).double(),
        data["action"],
        data["next", "reward"],
        data["next", "terminated"],
        inputs.read(data, ("next",)).double(),
    )
    ours_out, their_out = dict(zip(told, values, strict=True)), theirs(data.clone())
    for out in (ours_out, their_out):
        sum(out[name] for name in told[:3]).backward()
    for name in told:
        torch.testing.assert_close(ours_out[name], their_out[name].to(torch.float64), atol=1e-6, rtol=1e-6)
    for name, weight in loss.actor.named_parameters():
        other = theirs.actor_network_params["module", "0", "module", "body", *name.split(".")].grad
        torch.testing.assert_close(weight.grad, other, atol=1e-6, rtol=1e-6)
    for layer, (weight, bias) in enumerate(zip(critics.weights, critics.biases, strict=True)):
        other = theirs.qvalue_network_params["module", "body", str(2 * layer)]
        torch.testing.assert_close(weight.grad, other["weight"].grad.transpose(-1, -2), atol=1e-6, rtol=1e-6)
        torch.testing.assert_close(bias.grad.squeeze(1), other["bias"].grad, atol=1e-6, rtol=1e-6)
    torch.testing.assert_close(loss.log_alpha.grad, theirs.log_alpha.grad.double(), atol=1e-6, rtol=1e-6)


def test_networks_of_an_ensemble_are_perceptrons_side_by_side():
    critics, rows = EnsembleMLP(2, 5, 1, (8, 8), nn.ReLU).double(), torch.randn(7, 5, dtype=torch.float64)
    alone = torch.stack([member(critics, k)(rows) for k in range(2)])
    torch.testing.assert_close(critics(rows), alone)
    rows.requires_grad_()
    critics(rows, frozen=True).sum().backward()
    assert rows.grad.abs().sum() > 0
    assert all(weight.grad is None for weight in critics.parameters())


def test_a_target_follows():
    network = nn.Linear(2, 1)
    follower = Follower(network, 0.25)
    before = follower.network.weight.clone()
    network.weight.data.add_(1.0)
    follower.step()
    torch.testing.assert_close(follower.network.weight, before + 0.25)
    assert not any(weight.requires_grad for weight in follower.network.parameters())
    network.double(), follower.network.double()
    follower.step()
    torch.testing.assert_close(follower.network.weight, before.double() + 0.25 + 0.25 * 0.75)
    with pytest.raises(ValueError, match="tau"):
        Follower(network, 0.0)


def rows(values) -> TensorDict:
    values = torch.tensor(values, dtype=torch.float32)
    return TensorDict({"x": values, "next": {"reward": values.unsqueeze(-1)}}, (len(values),))


def test_a_ring_keeps_the_last_rows_together():
    buffer = TransitionBuffer(5)
    with pytest.raises(ValueError, match="empty"):
        buffer.sample(1)
    buffer.extend(rows([0, 1, 2]))
    assert len(buffer) == 3
    assert set(buffer.sample(100)["x"].tolist()) == {0, 1, 2}
    buffer.extend(rows([3, 4, 5, 6]))
    drawn = buffer.sample(200)
    assert set(drawn["x"].tolist()) == {2, 3, 4, 5, 6}
    assert torch.equal(drawn["x"], drawn["next", "reward"].squeeze(-1))
    buffer.extend(rows(range(10, 30)))
    assert set(buffer.sample(200)["x"].tolist()) == {25, 26, 27, 28, 29}


def test_a_ring_goes_on_where_it_stood(tmp_path):
    buffer, other = TransitionBuffer(5), TransitionBuffer(5)
    buffer.extend(rows(range(7)))
    torch.save(buffer.state_dict(), tmp_path / "ring.pt")
    other.load_state_dict(torch.load(tmp_path / "ring.pt", weights_only=True))
    for each in (buffer, other):
        each.extend(rows([7, 8]))
    places = torch.arange(5)
    assert torch.equal(buffer.at(places)["x"], other.at(places)["x"])
    assert set(other.sample(100)["x"].tolist()) == {4, 5, 6, 7, 8}
    with pytest.raises(BadInput, match="size 5"):
        TransitionBuffer(8).load_state_dict(buffer.state_dict())
