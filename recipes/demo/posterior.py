"""The posterior of a model's parameters given the measured runs: the mixture estimator, conditioned on them, in rounds.

    theta ~ proposal,   x = angles of all R runs at once, replayed by simulator(theta), read with sensor noise
    q(theta | x) by NeuralPosteriorLoss;   posterior = q(theta | measured);   proposal <- prior cut to its region

Each transition is told beside replays of the same commands at the proposal's centre and around it: residuals and
sensitivities make small differences of parameters visible in seconds of motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.embeddings import JoinedEmbedding, LSTMEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    Box,
    BoxUniform,
    MixtureEstimator,
    NeuralPosteriorLoss,
    Posterior,
    fit,
    proposals,
)
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import generator
from onlinebayes.simulators import Identifiable

CHUNK = 50  # parameters replayed at once: a rollout keeps every row of every run


@dataclass(frozen=True)
class Rounds:
    """Amount of inference.

    Args:
        rounds: of simulating, fitting and narrowing.
        simulations: replays a round.
        epochs: of a fit, at most.
        seconds: of each run that are used [s].
        every: rows from one observation to the next.
        hidden: width of the LSTM; a narrow one says less about data that no parameters explain.
    """

    rounds: int = 3
    simulations: int = 400
    epochs: int = 40
    seconds: float = 2.0
    every: int = 10
    hidden: int = 8


@dataclass(frozen=True)
class Experiment:
    """Commands and readings: R runs on one clock, which a model can replay.

    Args:
        simulator: the model; one of its steps is one row.
        command: (R, T, U), row k held over step k.
        angle: (K + 1, R) readings at every ``every``-th row, the first one at the start.
        noise: standard deviation of a reading [rad].
        every: rows between observations.
    """

    simulator: Identifiable
    command: Float[Tensor, "R T U"]
    angle: Float[Tensor, "K1 R"]
    noise: float
    every: int

    @classmethod
    def of(cls, simulator: Identifiable, measurement: Measurement, how: Rounds) -> Experiment:
        """The first seconds of every run."""
        data = measurement.data
        period = float(data["time"][0, 1] - data["time"][0, 0])
        rows = round(how.seconds / period) // how.every * how.every
        sd = measurement.signals[0].sd
        if sd is None:
            raise ValueError("the sensor's sd is needed to simulate its noise: give it with the signal")
        angle = data["signal"][:, : rows + 1 : how.every, 0].T
        return cls(simulator.with_timestep(period), data["command"][:, :rows], angle, sd, how.every)

    def replay(self, theta: Float[Tensor, "M P"]) -> Float[Tensor, "M K1 R"]:
        """True angles of every run at the rows of the observations, from rest [rad]."""
        return torch.cat([self._replay(some) for some in theta.split(CHUNK)])

    def _replay(self, theta: Tensor) -> Tensor:
        runs, rows = self.command.shape[:2]
        command = self.command.repeat(len(theta), 1, 1)
        inputs = TensorDict({"command": command}, batch_size=command.shape[:2])
        times = self.simulator.dt * torch.arange(1, rows + 1, dtype=torch.float64)
        at_rest = TensorDict({}, batch_size=command.shape[:1])
        path = self.simulator.rollout(theta.repeat_interleave(runs, 0), at_rest, inputs, times)["qpos"][..., 0]
        seen = torch.cat([torch.zeros_like(path[:, :1]), path[:, self.every - 1 :: self.every]], dim=1)
        return seen.unflatten(0, (len(theta), runs)).movedim(1, -1)

    def trajectories(self, angle: Float[Tensor, "M K1 R"], beside: Float[Tensor, "G K1 R"]) -> TensorDict:
        """Readings as trajectories (M, K); the action holds the commands and what the replays ``beside`` say next."""
        command = self.command[:, self.every - 1 :: self.every].flatten(2).movedim(0, 1).flatten(1)
        told = torch.cat([command, beside[:, 1:].movedim(0, 1).flatten(1)], dim=-1)
        return TensorDict(
            {
                "observation": angle[:, :-1],
                "action": told.expand(len(angle), -1, -1),
                "next": {"observation": angle[:, 1:]},
            },
            batch_size=(len(angle), len(told)),
        )


@dataclass(frozen=True)
class Beside:
    """The reference of :class:`TransitionFeatures`: replays that stand beside the commands in the action."""

    runs: int

    def __call__(self, observation: Tensor, action: Tensor) -> Tensor:
        """The replays' next angles (G, ..., R)."""
        return action[..., self.runs :].unflatten(-1, (-1, self.runs)).movedim(-2, 0)


def infer(
    simulator: Identifiable, measurement: Measurement, how: Rounds, seed: int, say: Callable[[str], None]
) -> Posterior:
    """The posterior of the simulator's parameters given the measured runs.

    Args:
        simulator: the model, with whatever effects were added to it.
        measurement: the runs to condition on, from rest; one actuator, one signal.
        how: the budget.
        seed: of draws, noise and networks.
        say: told about each round.
    """
    torch.manual_seed(seed)
    draw = generator(seed, "posterior")
    experiment, space = Experiment.of(simulator, measurement, how), simulator.parameters
    proposal: BoxUniform | proposals.TruncatedProposal = BoxUniform(space)
    for k in range(how.rounds):
        beside = experiment.replay(proposal.box.cross(0.5))
        theta = proposal.sample((how.simulations,), draw)
        angle = experiment.replay(theta)
        angle = angle + experiment.noise * torch.randn(angle.shape, generator=draw, dtype=angle.dtype)
        simulated = experiment.trajectories(angle, beside).set(
            "theta", theta[:, None].expand(-1, angle.shape[1] - 1, -1)
        )
        loss = estimator(space, proposal.box, angle.shape[-1], how)
        # As the figures of docs/results/demo-seeds were made: smaller steps than fit's own.
        report = fit(loss, simulated, generator=draw, epochs=how.epochs, batch_size=50, learning_rate=3e-3)
        posterior = Posterior(loss).condition(experiment.trajectories(experiment.angle[None], beside))
        # Inside the last one: a mixture's widest component would reach back to what earlier rounds ruled out.
        proposal = proposals.truncated(posterior, proposal, generator=draw)
        say(f"round {k + 1}: {how.simulations} simulations, {report.validation[report.best]:.1f} nats on unseen ones")
    return posterior


def estimator(space: ParameterSpace, box: Box, runs: int, how: Rounds) -> NeuralPosteriorLoss:
    """A fresh embedding and mixture for one round."""
    size = len(space)
    action = runs * (2 + 2 * size)
    features = TransitionFeatures(runs, action, products=False, reference=Beside(runs), sensitivities=size)
    embedding = JoinedEmbedding([LSTMEmbedding(features, how.hidden), SummaryEmbedding(features, averages=False)])
    return NeuralPosteriorLoss(embedding, MixtureEstimator(space, embedding.size, components=4, hidden=64, box=box))
