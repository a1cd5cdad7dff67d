"""The parts of a run, built once: worlds behind sensors, a collector, simulations, and the trainer over them.

    problem = Problem(simulator, task, prior, sensor_sd)
    trainer = online_trainer(problem, objective, estimator=..., real=..., schedule=..., sizes=..., seed=0)
    trainer.run(OnlineState.begin(problem.prior))

Every part can be built by hand instead and given to :class:`~onlinebayes.trainers.OnlineTrainer`; nothing here knows a
particular system.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Protocol, runtime_checkable

from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import Composite, TensorSpec
from torchrl.envs import Transform, TransformedEnv

from onlinebayes.inference import Belief, Gate, Hazard, PosteriorEstimator
from onlinebayes.objectives import Objective
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, generator
from onlinebayes.simulators import Simulator, SimulatorEnv, Task
from onlinebayes.trainers.collecting import collector_of
from onlinebayes.trainers.distributed import PartedCollector, PartedSimulations, Workers, in_parts
from onlinebayes.trainers.following import Follower
from onlinebayes.trainers.improve import Batches
from onlinebayes.trainers.online import OnlineTrainer
from onlinebayes.trainers.real import RealEnvironment, RealSystem
from onlinebayes.trainers.schedule import Schedule
from onlinebayes.trainers.simulations import Point, Simulations, TrajectorySource
from onlinebayes.trainers.trajectories import Policy, returns
from onlinebayes.transforms import Distribution, ParameterRandomization, SensorNoise

ALONE = "give estimator and real system, or the order policy-only"


@runtime_checkable
class Worlds(Protocol):
    """The interface under a trainer: :class:`Problem` of a simulator, :class:`EnvProblem` of any environment."""

    @property
    def prior(self) -> Belief:
        """Over the parameters."""

    def worlds(self, number: int, drawn: ParameterRandomization, seed: int) -> TransformedEnv:
        """``number`` worlds, their theta drawn by a transform, seen through the sensors."""

    def simulations(self, number: int, steps: int, seed: int) -> Simulations:
        """Build the source of ``number`` trajectories of ``steps`` steps."""

    def score(self, policy: Policy, truth: Float[Tensor, " P"]) -> float:
        """Mean return of a policy's deterministic action in worlds with these parameters."""


@dataclass(frozen=True)
class Problem:
    """A system with unknown parameters, its task and its sensors.

    Args:
        simulator: the system; any number of worlds.
        task: observation, reward and ending.
        prior: over the simulator's parameters.
        sensor_sd: standard deviation of each observed value's sensor (O,) [its unit]; None for perfect sensors.
        transforms: gives further transforms for one environment, behind the sensors; a recurrent policy's
            ``ActorCritic.transforms``, for example.
    """

    simulator: Simulator
    task: Task
    prior: Belief
    sensor_sd: Float[Tensor, " O"] | None = None
    transforms: Callable[[], Iterable[Transform]] = tuple

    @property
    def space(self) -> ParameterSpace:
        """The unknown parameters."""
        return self.simulator.parameters

    @property
    def specs(self) -> tuple[Composite, TensorSpec]:
        """Observation and action spec of one world, which objectives are built from."""
        env = SimulatorEnv(self.simulator.with_worlds(1), self.task)
        return env.observation_spec_unbatched, env.action_spec_unbatched

    def worlds(
        self, number: int, drawn: ParameterRandomization, seed: int, *, with_state: bool = False
    ) -> TransformedEnv:
        """``number`` worlds, their theta drawn by a transform, seen through the sensors; their states too if wanted."""
        simulator = self.simulator.with_worlds(number)
        env = TransformedEnv(SimulatorEnv(simulator, self.task, seed=seed, with_state=with_state), drawn)
        return behind_sensors(env, self.sensor_sd, self.transforms, seed)

    def simulations(self, number: int, steps: int, seed: int) -> Simulations:
        """``number`` worlds that are asked for trajectories of ``steps`` steps."""
        drawn = ParameterRandomization(self.prior)
        return Simulations(self.worlds(number, drawn, seed), drawn, steps)

    def hidden(self, truth: Float[Tensor, " P"], seed: int) -> RealEnvironment:
        """One world with these parameters, in the place of a real system."""
        return RealEnvironment(self.worlds(1, ParameterRandomization(Point(truth)), seed))

    def score(self, policy: Policy, truth: Float[Tensor, " P"], episodes: int = 64, seed: int = 999) -> float:
        """Mean return of a policy's deterministic action in worlds with these parameters, behind the sensors."""
        env = self.worlds(episodes, ParameterRandomization(Point(truth)), seed)
        return float(returns(env, policy, self.task.horizon).mean())


def behind_sensors(
    env: TransformedEnv,
    sd: Float[Tensor, " O"] | None,
    transforms: Callable[[], Iterable[Transform]],
    seed: int,
) -> TransformedEnv:
    """The environment with its sensors' noise, where there is any, and further transforms."""
    if sd is not None and bool((sd > 0).any()):
        env.append_transform(SensorNoise(sd.to(env.device or sd.device), seed=seed))
    for transform in transforms():
        env.append_transform(transform)
    return env


@dataclass(frozen=True)
class Sizes:
    """Numbers of worlds, steps and trajectories of each kind.

    Args:
        worlds: that the policy learns in.
        batch_steps: steps of each of them in one batch.
        simulations: trajectories for a fit, of each policy that it has to know.
        groups: held-out thetas by which the belief is judged.
    """

    worlds: int = 64
    batch_steps: int = 64
    simulations: int = 500
    groups: int = 64


def online_trainer(
    problem: Worlds,
    objective: Objective,
    *,
    estimator: Callable[[Belief], PosteriorEstimator] | None = None,
    real: RealSystem | None = None,
    schedule: Schedule,
    sizes: Sizes,
    gate: Gate | None = None,
    worlds: Distribution | None = None,
    learn_in: Worlds | None = None,
    workers: Workers | None = None,
    repeats: bool = False,
    hazard: Hazard | None = None,
    seed: int = 0,
) -> OnlineTrainer:
    """The trainer over worlds of one problem.

    Args:
        problem: system, task, prior and sensors.
        objective: policy and learning, built from :attr:`Problem.specs`.
        estimator: proposal -> a fresh estimator in its box; not needed where the policy learns alone.
        real: the system in question; not needed where the policy learns alone.
        schedule: how much of each step, and in which order.
        sizes: how many worlds of each kind.
        gate: decides on the next proposal; with a hazard it stays the prior.
        worlds: where the policy's worlds come from; the belief without it.
        learn_in: the problem in whose worlds the policy learns, as a faster simulator's; ``problem`` without it.
        workers: step the worlds, of the policy and of the simulations; without them this process does.
        repeats: whether simulations repeat the commands of real trajectories, see :class:`OnlineTrainer`.
        hazard: how the machine may change in mid-run; without it one machine is thought to make all trajectories.
        seed: of worlds, sensors, fits and proposals.

    Raises:
        BadInput: a schedule that infers, without an estimator or a real system; a hazard beside a prior that is not
            uniform, or beside a gate that narrows.
    """
    if (estimator is None or real is None) and any(turn.infers for turn in schedule.turns):
        missing = "estimator" if estimator is None else "real system"
        raise BadInput(f"order '{schedule.order}' without a{'n' * (estimator is None)} {missing}", ALONE)
    drawn, learns = ParameterRandomization(problem.prior), any(turn.policy_batches for turn in schedule.turns)
    taught_in = learn_in if learn_in is not None else problem
    simulations = partial(_simulations, problem, schedule.real_steps, workers)
    return OnlineTrainer(
        objective=objective,
        collector=_collector(taught_in, objective.policy, sizes, drawn, workers, seed) if learns else _NoBatches(),
        randomization=drawn,
        simulations=simulations(sizes.simulations, seed + 1000),
        held_out=simulations(sizes.groups, seed + 3000),
        estimator=estimator if estimator is not None else _no_estimator,
        gate=gate if gate is not None else Gate(narrows=hazard is None),
        real=real if real is not None else _NoSystem(),
        schedule=schedule,
        generator=generator(seed, "online"),
        worlds=worlds,
        repeats=repeats,
        follower=None if hazard is None else Follower(problem.prior, hazard),
    )


def _collector(
    problem: Worlds, policy: Policy, sizes: Sizes, drawn: ParameterRandomization, workers: Workers | None, seed: int
) -> Batches:
    """The policy's batches."""
    if workers is None:
        return collector_of(problem.worlds(sizes.worlds, drawn, seed), policy, sizes.batch_steps)
    makes = in_parts(problem.worlds, sizes.worlds, workers.number, seed)
    return PartedCollector(makes, policy, sizes.batch_steps, drawn, workers, seed)


def _simulations(problem: Worlds, steps: int, workers: Workers | None, number: int, seed: int) -> TrajectorySource:
    """Trajectories for a fit."""
    if workers is None:
        return problem.simulations(number, steps, seed)
    return PartedSimulations(problem.worlds, number, steps, workers, seed, most=getattr(problem, "beside", None))


class _NoBatches:
    """In the place of a collector where nothing is learnt: building one would ask the policy to act."""

    def reset(self) -> None:
        """There are no episodes."""

    def next(self) -> None:
        """There are no batches."""


class _NoSystem:
    """In the place of a real system where the policy learns alone."""

    def run(self, policy: Policy, steps: int) -> TensorDict | None:
        """Nothing is ever measured."""
        return None


def _no_estimator(proposal: Belief) -> PosteriorEstimator:
    raise BadInput("there is no estimator", ALONE)
