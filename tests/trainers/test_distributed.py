"""The same work here and on Ray: equal to the last bit, whichever worker is killed in the middle."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import pytest
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torchrl.envs import Transform

from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import Belief, BoxUniform, MixtureEstimator, NeuralEstimator, NeuralPosteriorLoss, fit
from onlinebayes.objectives import PPOSettings, ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, Checkpoints, plain, seed_everything
from onlinebayes.trainers import (
    OnlineState,
    OnlineTrainer,
    Point,
    Problem,
    RealEnvironment,
    Saver,
    Schedule,
    Sizes,
    collector_of,
    online_trainer,
)
from onlinebayes.trainers.checkpoint import run_state
from onlinebayes.trainers.distributed import (
    Here,
    OnRay,
    PartedCollector,
    PartedSimulations,
    Workers,
    check_workers,
    in_parts,
)
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.survival import differing

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
PRIOR = BoxUniform(SPACE)
PROBLEM = Problem(Pendulum(SPACE), PendulumTask(horizon=11), PRIOR, torch.full((3,), 0.01))
BELIEVED = torch.tensor([0.4, 0.3], dtype=torch.float64)
WORLDS, STEPS = 7, 8
WHERE = ["here", pytest.param("ray", marks=pytest.mark.slow)]


@pytest.fixture(scope="module")
def ray() -> Iterator[OnRay]:
    """Two workers that all tests of this file share, for it takes seconds to start them."""
    workers = OnRay(2)
    yield workers
    workers.close()


@pytest.fixture(params=WHERE)
def workers(request: pytest.FixtureRequest) -> Workers:
    return Here(2) if request.param == "here" else request.getfixturevalue("ray")


class Killing(Transform):
    """Kills its process at the given step of its environment, once: where the file is there, somebody died before."""

    def __init__(self, file: Path, step: int) -> None:
        super().__init__()
        self.file, self.left = file, step

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        self.left -= 1
        if self.left == 0 and not self.file.exists():
            self.file.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)
        return next_tensordict


def killing(file: Path, step: int) -> Problem:
    """The problem; the first worker whose worlds have made so many steps is killed."""
    return replace(PROBLEM, transforms=partial(_one, file, step))


def _one(file: Path, step: int) -> tuple[Transform, ...]:
    return (Killing(file, step),)


def policy():
    seed_everything(0)
    return ppo(*PROBLEM.specs).policy


def collector(workers: Workers, problem: Problem = PROBLEM) -> tuple[PartedCollector, ParameterRandomization, Callable]:
    drawn, acts = ParameterRandomization(PRIOR), policy()
    makes = in_parts(problem.worlds, WORLDS, workers.number, 3)
    return PartedCollector(makes, acts, STEPS, drawn, workers, 3), drawn, acts


def batches(workers: Workers, problem: Problem = PROBLEM, number: int = 4) -> list[TensorDictBase]:
    """Of a policy and a belief that change after two of them."""
    made, drawn, acts = collector(workers, problem)
    made.reset()
    found = []
    for i in range(number):
        if i == 2:
            drawn.set_distribution(Point(BELIEVED))
            with torch.no_grad():
                next(acts.parameters()).add_(0.5)
        found.append(made.next())
    return found


def same(first: TensorDictBase, second: TensorDictBase) -> bool:
    """To the last bit, with the same keys."""
    keys = set(first.keys(True, True))
    return keys == set(second.keys(True, True)) and all(torch.equal(first[key], second[key]) for key in keys)


def test_the_workers_do_what_is_asked_of_workers(workers: Workers) -> None:
    check_workers(workers)


def test_batches_follow_the_belief_and_the_policy(workers: Workers) -> None:
    found = batches(workers)
    assert [batch.shape for batch in found] == 4 * [(WORLDS, STEPS)]
    assert all(same(*pair) for pair in zip(found, batches(Here(2)), strict=True)), "as here"
    ended = found[1]["next", "done"][:, :, 0].any(1)
    assert ended.all(), "episodes last 11 steps"
    assert len(found[0]["theta"][:, 0].unique(dim=0)) == WORLDS, "a theta for each world"
    last = found[3]["theta"]
    assert torch.equal(last[:, -1], BELIEVED.expand(WORLDS, 2)), "of the belief by then"
    unchanged, drawn, _ = collector(workers)
    unchanged.reset()
    others = [unchanged.next() for _ in range(3)]
    assert same(found[1], others[1])
    assert not torch.equal(found[2]["action"], others[2]["action"]), "of the policy by then"
    assert drawn.distribution is PRIOR


def test_parts_draw_each_their_own(workers: Workers) -> None:
    assert len(batches(workers, number=1)[0]["theta"][:, 0].unique(dim=0)) == WORLDS


def test_a_collector_goes_on_from_its_checkpoint(workers: Workers, tmp_path: Path) -> None:
    made, _, _ = collector(workers)
    made.reset()
    made.next()
    Checkpoints(tmp_path, "test").save({"collector": made.state_dict()})
    expected = [made.next() for _ in range(2)]
    saved = Checkpoints(tmp_path, "test").load().state["collector"]
    fresh, _, _ = collector(Here(2))
    fresh.load_state_dict(saved)
    assert [same(each, fresh.next()) for each in expected] == [True, True]
    made.load_state_dict(saved)
    assert [same(each, made.next()) for each in expected] == [True, True], "and goes back"
    with pytest.raises(ValueError, match="saved in 2 parts, now there are 1"):
        collector(Here(1))[0].load_state_dict(saved)


def test_simulations_come_in_the_order_of_their_thetas(workers: Workers) -> None:
    made, acts = PartedSimulations(PROBLEM.worlds, WORLDS, STEPS, workers, 5), policy()
    seed_everything(1)
    found = made.draw([acts, acts], PRIOR)
    seed_everything(1)
    theta = torch.cat([PRIOR.sample((WORLDS,)) for _ in range(2)])
    assert torch.equal(found["theta"], theta[:, None].expand(-1, STEPS, -1))
    groups = made.groups([acts, acts, acts], PRIOR)
    assert groups.shape == (WORLDS, 3, STEPS)
    assert (groups["theta"] == groups["theta"][:, :1, :1]).all()
    assert not torch.equal(groups["action"][:, 0], groups["action"][:, 1])
    again = PartedSimulations(PROBLEM.worlds, WORLDS, STEPS, Here(2), 5)
    seed_everything(1)
    assert same(again.draw([acts, acts], PRIOR), found), "as here"
    assert same(again.groups([acts, acts, acts], PRIOR), groups)
    later = PartedSimulations(PROBLEM.worlds, WORLDS, STEPS, workers, 5)
    later.load_state_dict({"draws": 1})
    seed_everything(1)
    PRIOR.sample((WORLDS,)), PRIOR.sample((WORLDS,))
    assert same(later.groups([acts, acts, acts], PRIOR), groups), "goes on from there"


class Still(PendulumTask):
    """Every episode begins alike."""

    def start(self, theta, generator):
        return super().start(theta, generator).apply(lambda each: torch.full_like(each, 0.3))


def against(observation: torch.Tensor) -> torch.Tensor:
    """A torque against the rate."""
    return -observation[..., 2:]


def test_without_chance_parts_give_what_the_whole_gives(workers: Workers) -> None:
    """The same thetas, no noise, a policy that draws nothing: then the plain simulations give the same set."""
    problem = replace(PROBLEM, task=Still(horizon=STEPS), sensor_sd=None)
    acts = TensorDictModule(against, ["observation"], ["action"])
    seed_everything(1)
    whole = problem.simulations(WORLDS, STEPS, 5).draw([acts], PRIOR)
    seed_everything(1)
    parts = PartedSimulations(problem.worlds, WORLDS, STEPS, workers, 99).draw([acts], PRIOR)
    assert same(parts, whole)
    drawn, believed = ParameterRandomization(PRIOR), ParameterRandomization(Point(BELIEVED))
    plain = collector_of(problem.worlds(WORLDS, believed, 5), acts, 5)
    parted = PartedCollector(in_parts(problem.worlds, WORLDS, 2, 99), acts, 5, drawn, workers, 99)
    drawn.set_distribution(Point(BELIEVED))
    parted.reset()
    assert [same(parted.next(), plain.next()) for _ in range(4)] == 4 * [True], "episodes end in between"


@pytest.mark.slow
@pytest.mark.parametrize("step", [3, 2 * STEPS + 3])
def test_a_worker_killed_in_a_batch_loses_nothing(ray: OnRay, tmp_path: Path, step: int) -> None:
    file = tmp_path / "killed"
    found = batches(ray, killing(file, step))
    assert int(file.read_text()) != os.getpid(), "somebody died"
    assert [same(*pair) for pair in zip(found, batches(Here(2)), strict=True)] == 4 * [True]


@pytest.mark.slow
def test_a_worker_killed_between_two_batches_loses_nothing(ray: OnRay, tmp_path: Path) -> None:
    made, _, _ = collector(ray, replace(PROBLEM, transforms=partial(_told, tmp_path)))
    made.reset()
    found = [made.next()]
    for file in tmp_path.iterdir():
        os.kill(int(file.name), signal.SIGKILL)
    found.append(made.next())
    expected, _, _ = collector(Here(2))
    expected.reset()
    assert [same(each, expected.next()) for each in found] == [True, True]
    assert len(list(tmp_path.iterdir())) == 4, "two workers, and two in their places"


def _told(folder: Path) -> tuple[Transform, ...]:
    (folder / str(os.getpid())).touch()
    return ()


@pytest.mark.slow
def test_a_worker_killed_in_a_simulation_loses_nothing(ray: OnRay, tmp_path: Path) -> None:
    file, acts = tmp_path / "killed", policy()
    seed_everything(1)
    found = PartedSimulations(killing(file, 3).worlds, WORLDS, STEPS, ray, 5).draw([acts], PRIOR)
    assert int(file.read_text()) != os.getpid(), "somebody died"
    seed_everything(1)
    assert same(found, PartedSimulations(PROBLEM.worlds, WORLDS, STEPS, Here(2), 5).draw([acts], PRIOR))


def pid(_: int) -> int:
    return os.getpid()


@dataclass
class Deadly:
    """In the place of the real system: kills a worker whenever it is asked."""

    real: RealEnvironment
    workers: Workers
    killed: list[int] = field(default_factory=list)

    def run(self, policy, steps):
        victim = max(dict(self.workers.work(pid, range(2))).values())
        if victim != os.getpid():
            os.kill(victim, signal.SIGKILL)
            self.killed.append(victim)
        return self.real.run(policy, steps)

    def state_dict(self):
        return self.real.state_dict()

    def load_state_dict(self, state):
        self.real.load_state_dict(state)


def trainer(workers: Workers) -> OnlineTrainer:
    """Small, and whatever it believes."""
    seed_everything(0)
    problem = replace(PROBLEM, task=PendulumTask(horizon=30))
    return online_trainer(
        problem,
        ppo(*problem.specs, PPOSettings(minibatch=64, epochs=1)),
        estimator=estimator,
        real=Deadly(problem.hidden(BELIEVED, 7), workers),
        schedule=Schedule(2, 2, real_steps=20, behaviours=2),
        sizes=Sizes(worlds=7, batch_steps=16, simulations=61, groups=24),
        workers=workers,
        seed=0,
    )


def estimator(proposal: Belief) -> NeuralEstimator:
    embedding = SummaryEmbedding(TransitionFeatures(3, 1))
    network = MixtureEstimator(SPACE, embedding.size, hidden=16, box=proposal.box)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=2, batch_size=50))


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
def test_a_run_whose_workers_die_and_that_is_stopped_ends_as_one_here(ray: OnRay, tmp_path: Path) -> None:
    """One dies in each outer step; between the two the run is begun anew from its checkpoint."""
    expected, state = trainer(Here(2)), OnlineState.begin(PRIOR)
    whole = run_state(expected, expected.run(state))
    first, begun = trainer(ray), OnlineState.begin(PRIOR)
    first.run(begun, checkpoint=Saver(first, Checkpoints(tmp_path, "test")), until=1)
    second, state = trainer(ray), OnlineState.begin(PRIOR)
    assert Saver(second, Checkpoints(tmp_path, "test")).resume(state)
    found = run_state(second, second.run(state))
    assert (len(first.real.killed), len(second.real.killed)) == (1, 1)
    for each in (whole, found):
        each["random"].pop("python")  # Ray draws from it, and nothing of ours does
    assert (state.frames, state.simulated) == (2 * 2 * 7 * 16, (61 + 24 + 2 * 61 + 2 * 24) * 20)
    assert differing(plain(whole), plain(found)) == []


@pytest.mark.slow
def test_more_workers_than_a_cluster_has_room_for_are_refused(ray: OnRay) -> None:
    list(ray.work(abs, [1]))
    with pytest.raises(BadInput, match="999 Ray workers of 1 CPUs, and the cluster has"):
        list(OnRay(999).work(abs, [1]))


@pytest.mark.slow
def test_work_that_always_kills_its_worker_ends(ray: OnRay) -> None:
    ray.close()
    alone = OnRay(1, retries=1)
    try:
        with pytest.raises(BadInput, match=r"died at a piece of work that is tried 2 times: .*; look at their memory"):
            list(alone.work(os._exit, [3]))
    finally:
        alone.close()


def test_no_workers_are_refused() -> None:
    with pytest.raises(BadInput, match="give at least one of each"):
        OnRay(0)


WITHOUT = """
import sys
sys.modules["ray"] = None  # as if it were not installed
import onlinebayes.cli.main, onlinebayes.trainers.distributed as distributed
try:
    distributed.OnRay(2)
except ValueError as error:
    print(error)
"""


@pytest.mark.slow
def test_ray_is_an_extra() -> None:
    told = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=True, timeout=120)
    assert told.stdout == "Ray is not installed; pip install 'onlinebayes[ray]'\n"
