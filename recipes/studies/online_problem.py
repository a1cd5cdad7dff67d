"""One run of Online BayesSim on a system with a hidden theta, and the policies it is compared with.

    online    Algorithm 1 against a system with the hidden truth
    oracle    the same policy learning, with as many frames, in worlds that all have the truth
    prior     the same in worlds drawn from the prior, to the end

Every policy is judged on the real system by the mean return of 64 episodes under its deterministic action; the
posterior by the log density it gives the truth. The trainer sees neither.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor
from torchrl.collectors import Collector
from torchrl.data import TensorSpec
from torchrl.envs import TransformedEnv

from onlinebayes.embeddings import (
    JoinedEmbedding,
    LSTMEmbedding,
    SimulatorReference,
    SummaryEmbedding,
    TransitionFeatures,
)
from onlinebayes.inference import BoxUniform, MixtureEstimator, NeuralPosteriorLoss, fit, proposals
from onlinebayes.objectives import Objective
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import generator, seed_everything
from onlinebayes.simulators import SimulatorEnv, Task, TorchSimulator
from onlinebayes.trainers import (
    HiddenSystem,
    OnlineState,
    OnlineTrainer,
    Policy,
    Proposal,
    Schedule,
    improve,
    returns,
    trajectories,
)
from onlinebayes.transforms import ParameterRandomization, SensorNoise

EPISODES = 64


@dataclass(frozen=True)
class Goals:
    """What the medians over the seeds are to reach.

    Args:
        log_density: of the truth, above this.
        score: return, at least this; None where only the distance to the oracle counts.
        regret: oracle's return minus return, at most this; None where only the return counts.
        default_score: return at the default truth, at least this.
    """

    log_density: float
    score: float | None = None
    regret: float | None = None
    default_score: float | None = None


@dataclass(frozen=True)
class Problem:
    """A system, its task and how much effort a run may take.

    Args:
        name: of the recipe.
        simulator: the system; its parameters' bounds are the prior's box.
        task: observation, reward and ending.
        state: observation (M, O) -> state, so that a reference can simulate on from what was observed.
        sensor_range: width of the range of each observed value (O,), to which sensor noise is relative.
        objective: (observation spec, action spec) -> policy and learning.
        goals: of the study.
        schedule: outer steps and policy batches.
        worlds: number of worlds that the policy learns in.
        batch_steps: steps of each world in one batch.
        simulations: trajectories for each fit, of each policy that it has to know.
        epochs: passes over them in each fit.
        hidden: width of the LSTM.
    """

    name: str
    simulator: TorchSimulator
    task: Task
    state: Callable[[Tensor], TensorDict]
    sensor_range: tuple[float, ...]
    objective: Callable[[TensorSpec, TensorSpec], Objective]
    goals: Goals
    schedule: Schedule
    worlds: int = 64
    batch_steps: int = 64
    simulations: int = 500
    epochs: int = 25
    hidden: int = 32

    @property
    def space(self) -> ParameterSpace:
        """The unknown parameters, with the prior's bounds."""
        return self.simulator.parameters


@dataclass(frozen=True)
class Point:
    """The distribution that always gives the same theta (P,)."""

    theta: Float[Tensor, " P"]

    def sample(self, shape: tuple[int, ...], /) -> Tensor:
        """Theta (*shape, P)."""
        return self.theta.expand(*shape, -1)


def online(
    problem: Problem,
    truth: Float[Tensor, " P"],
    noise: float,
    seed: int,
    on_step: Callable[[OnlineState, Objective], None],
) -> tuple[OnlineState, Objective]:
    """One run of Algorithm 1 against a system with the hidden ``truth``."""
    seed_everything(seed)
    prior, objective = BoxUniform(problem.space), learner(problem)
    drawn, simulated = ParameterRandomization(prior), ParameterRandomization(prior)
    simulations = worlds(problem, problem.simulations, simulated, noise, seed + 1000)

    def simulate(policy: Policy, proposal: Proposal) -> TensorDict:
        simulated.set_distribution(proposal)
        return trajectories(simulations, policy, problem.schedule.real_steps)

    trainer = OnlineTrainer(
        objective=objective,
        collector=collector(problem, objective, drawn, noise, seed),
        randomization=drawn,
        simulate=simulate,
        estimator=partial(estimator, problem),
        fit=partial(fit, generator=generator(seed, "fit"), epochs=problem.epochs, batch_size=50, learning_rate=4e-3),
        # Wider than the default: a truth on the prior's edge, as Gymnasium's are, is read worst by young estimators.
        narrow=partial(proposals.truncated, generator=generator(seed, "narrow"), dilation=2.0),
        real=HiddenSystem(worlds(problem, 1, ParameterRandomization(Point(truth)), noise, seed + 2000)),
        schedule=problem.schedule,
    )
    return trainer.run(OnlineState(prior), lambda state: on_step(state, objective)), objective


def offline(problem: Problem, drawn: ParameterRandomization, noise: float, seed: int) -> Objective:
    """A policy from the same learning and as many frames, in worlds that do not change with what is measured."""
    seed_everything(seed)
    objective = learner(problem)
    batches = problem.schedule.steps * problem.schedule.policy_batches
    improve(objective, collector(problem, objective, drawn, noise, seed), batches)
    return objective


def score(problem: Problem, policy: Policy, truth: Float[Tensor, " P"], noise: float) -> float:
    """Mean return of a policy on the real system."""
    env = worlds(problem, EPISODES, ParameterRandomization(Point(truth)), noise, 999)
    return float(returns(env, policy, problem.task.horizon).mean())


def worlds(problem: Problem, number: int, drawn: ParameterRandomization, noise: float, seed: int) -> TransformedEnv:
    """``number`` worlds, seen through sensors whose noise is ``noise`` of each range."""
    env = TransformedEnv(SimulatorEnv(problem.simulator.with_worlds(number), problem.task, seed=seed), drawn)
    if noise:
        env.append_transform(SensorNoise(noise * torch.tensor(problem.sensor_range), seed=seed))
    return env


def learner(problem: Problem) -> Objective:
    """The problem's objective, fresh."""
    env = SimulatorEnv(problem.simulator, problem.task)
    return problem.objective(env.observation_spec_unbatched["observation"], env.action_spec_unbatched)


def collector(
    problem: Problem, objective: Objective, drawn: ParameterRandomization, noise: float, seed: int
) -> Collector:
    """The policy's batches (worlds, batch_steps), without end."""
    return Collector(
        worlds(problem, problem.worlds, drawn, noise, seed),
        objective.policy,
        frames_per_batch=problem.worlds * problem.batch_steps,
        total_frames=-1,
        trust_policy=True,
        track_traj_ids=False,
        auto_register_policy_transforms=False,
    )


def estimator(problem: Problem, proposal: Proposal) -> NeuralPosteriorLoss:
    """Fresh embedding and mixture in the proposal's box; residuals are against simulations from its centre."""
    task = problem.task
    reference = SimulatorReference(
        problem.simulator, proposal.box.cross(), state=problem.state, command=task.command, observe=task.observe
    )
    features = TransitionFeatures(
        task.observation_size, task.action_spec.shape[-1], reference=reference, sensitivities=len(problem.space)
    )
    embedding = JoinedEmbedding([LSTMEmbedding(features, hidden=problem.hidden), SummaryEmbedding(features)])
    return NeuralPosteriorLoss(embedding, MixtureEstimator(problem.space, embedding.size, box=proposal.box))
