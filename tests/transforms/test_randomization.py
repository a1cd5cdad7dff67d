"""Theta is drawn for exactly the worlds that reset, stays within an episode, and reaches the simulator."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.collectors import Collector, MultiSyncCollector
from torchrl.envs import EnvBase, ParallelEnv, SerialEnv, TransformedEnv

from onlinebayes.inference import BoxUniform
from onlinebayes.runs import BadInput, worker_seed
from onlinebayes.transforms import ParameterRandomization, SensorNoise
from onlinebayes.transforms.testing import check_parallel, check_transform
from recipes import custom_gym
from tests.transforms.systems import Uniform, make_env


def test_conforms() -> None:
    check_transform(make_env, _transform, lambda: TensorDict({"x": torch.zeros(4, 5, 1)}, batch_size=(4, 5)))


@pytest.mark.slow
def test_conforms_in_processes() -> None:
    check_parallel(make_env, _transform)


def test_new_parameters_exactly_where_an_episode_ended() -> None:
    env = TransformedEnv(make_env(worlds=8), ParameterRandomization(Uniform()))
    collector = Collector(env, frames_per_batch=8 * 120, total_frames=8 * 120, track_traj_ids=False)
    data = next(iter(collector))
    ended, theta = data["next", "done"][:, :-1, 0], data["theta"]
    assert ended.sum() > 10
    assert theta[:, 0].unique(dim=0).shape[0] == 8  # every world its own
    assert torch.equal((theta[:, 1:] != theta[:, :-1]).any(-1), ended)
    assert torch.equal(data["next", "theta"], theta)  # carried through the step that ends an episode


def test_no_draw_is_made_for_worlds_that_go_on() -> None:
    distribution = Uniform()
    env = TransformedEnv(make_env(worlds=8), ParameterRandomization(distribution))
    state = env.reset()
    assert distribution.asked == [8]
    for _ in range(80):
        distribution.asked.clear()
        data, state = env.step_and_maybe_reset(env.rand_action(state))
        assert sum(distribution.asked) == int(data["next", "done"].sum())


def test_the_simulator_runs_on_what_was_drawn() -> None:
    env = TransformedEnv(make_env(worlds=4), ParameterRandomization(Uniform()))
    data = env.rollout(80, break_when_any_done=False)
    assert torch.equal(env.simulator.theta, data["next", "theta"][:, -1])


def test_the_simulators_below_several_environments_get_their_own_rows() -> None:
    env = TransformedEnv(SerialEnv(2, make_env), ParameterRandomization(Uniform()))
    data = env.rollout(80, break_when_any_done=False)
    below = torch.stack([inner.simulator.theta for inner in env.base_env._envs])
    assert torch.equal(below, data["next", "theta"][:, :, -1])
    assert below.reshape(-1, 2).unique(dim=0).shape[0] == 6


def test_a_new_distribution_takes_effect_world_by_world() -> None:
    env = TransformedEnv(make_env(worlds=6), ParameterRandomization(Uniform(0.1, 0.2)))
    state = env.reset()
    env.transform.set_distribution(Uniform(0.8, 0.9))
    assert (state["theta"] < 0.2).all()
    seen_both = False
    for _ in range(80):
        _, state = env.step_and_maybe_reset(env.rand_action(state))
        old, new = (state["theta"] < 0.2).all(-1), (state["theta"] > 0.8).all(-1)
        assert (old ^ new).all()
        seen_both |= bool(old.any() and new.any())
    assert seen_both
    assert new.all()


def test_partial_reset_by_hand() -> None:
    env = TransformedEnv(make_env(worlds=3), ParameterRandomization(Uniform()))
    state = env.reset()
    before = state["theta"].clone()
    mask = torch.tensor([[True], [False], [True]])
    state["_reset"] = mask
    after = env.reset(state)["theta"]
    assert torch.equal((after != before).any(-1, keepdim=True), mask)


def test_as_a_module_it_draws_for_every_element() -> None:
    data = ParameterRandomization(Uniform())(TensorDict(batch_size=(5, 2)))
    assert data["theta"].shape == (5, 2, 2)
    assert data["theta"].reshape(10, 2).unique(dim=0).shape[0] == 10


def _transform() -> ParameterRandomization:
    return ParameterRandomization(Uniform())


# --- a theta that is given ------------------------------------------------------------------------------------------

WANTED = torch.tensor([[0.2, 0.9], [0.5, 0.5], [0.9, 0.2]], dtype=torch.float64)


def randomised() -> TransformedEnv:
    return TransformedEnv(make_env(), _transform())


def several() -> SerialEnv:
    return SerialEnv(2, randomised)


def behind_noise() -> TransformedEnv:
    env = randomised()
    env.append_transform(SensorNoise(torch.full((4,), 0.01)))
    return env


@pytest.mark.parametrize("make", [randomised, behind_noise, several])
def test_a_theta_that_is_given_stays_until_the_world_resets(make: Callable[[], EnvBase]) -> None:
    env = make()
    wanted = WANTED.expand(*env.batch_size, 2).clone()
    for _ in range(2):  # the second time the worlds have it already
        state = env.reset(TensorDict({"theta": wanted}, env.batch_size), set_state=False)
        assert torch.equal(state["theta"], wanted)
    data = env.rollout(80, break_when_any_done=False, auto_reset=False, tensordict=state)
    ended = data["next", "done"][..., :-1, 0]
    assert ended.any()
    assert torch.equal((data["theta"].diff(dim=-2) != 0).any(-1), ended)


def test_in_a_partial_reset_a_theta_is_given_where_it_is_another() -> None:
    env = TransformedEnv(make_env(worlds=3), ParameterRandomization(Uniform()))
    state = env.reset()
    before = state["theta"].clone()
    state["theta"] = torch.stack([before[0], WANTED[1], WANTED[2]])
    state["_reset"] = torch.tensor([[True], [True], [False]])
    env.reset(state)
    after = env.simulator.theta
    assert not torch.equal(after[0], before[0])
    assert torch.equal(after[1], WANTED[1])
    assert torch.equal(after[2], before[2]), "a world that goes on keeps its own"


def test_a_theta_that_is_given_uses_up_no_random_numbers() -> None:
    distribution = Uniform()
    env = TransformedEnv(make_env(), ParameterRandomization(distribution))
    env.reset(TensorDict({"theta": WANTED}, (3,)))
    assert not distribution.asked


def test_a_given_theta_outside_the_bounds_is_refused() -> None:
    env = randomised()
    with pytest.raises(BadInput):
        env.reset(TensorDict({"theta": torch.full((3, 2), torch.nan)}, (3,)))


# --- worlds in worker processes -------------------------------------------------------------------------------------


def draws(env: EnvBase, resets: int = 3) -> Tensor:
    """Theta of every world at some resets, (resets * worlds, 2)."""
    try:
        return torch.cat([env.reset()["theta"].reshape(-1, 2) for _ in range(resets)])
    finally:
        env.close()


def swinging() -> TransformedEnv:
    """One of Gymnasium's pendulums, randomised where it is made."""
    return TransformedEnv(custom_gym.pendulum(), ParameterRandomization(BoxUniform(custom_gym.SPACE)))


BESIDE: dict[str, Callable[[Callable[[], EnvBase]], EnvBase]] = {
    "serial": lambda make: SerialEnv(3, make),
    "forked": lambda make: ParallelEnv(3, make, mp_start_method="fork"),
    "spawned": lambda make: ParallelEnv(3, make, mp_start_method="spawn"),
    "as TorchRL starts them": lambda make: ParallelEnv(3, make),
    "serial in forked": lambda make: ParallelEnv(2, partial(SerialEnv, 2, make), mp_start_method="fork"),
}


@pytest.mark.parametrize("make", [randomised, swinging], ids=["simulator", "gymnasium"])
@pytest.mark.parametrize("seed", [None, 5])
@pytest.mark.parametrize("beside", [pytest.param(b, marks=[pytest.mark.slow] * (b != "serial")) for b in BESIDE])
def test_environments_of_environments_draw_each_their_own(
    beside: str, seed: int | None, make: Callable[[], EnvBase]
) -> None:
    torch.manual_seed(0)
    env = BESIDE[beside](make)
    if seed is not None:
        env.set_seed(seed)
    found = draws(env)
    assert len(found.unique(dim=0)) == len(found)


@pytest.mark.slow
@pytest.mark.parametrize("make", [randomised, swinging], ids=["simulator", "gymnasium"])
def test_collectors_in_processes_draw_each_their_own(make: Callable[[], EnvBase]) -> None:
    worlds = make().batch_size.numel()
    torch.manual_seed(0)
    collector = MultiSyncCollector([make] * 3, None, frames_per_batch=3 * worlds * 4, total_frames=-1)
    try:
        batch = next(iter(collector))
    finally:
        collector.shutdown()
    assert len(batch["theta"].reshape(-1, 2).unique(dim=0)) == 3 * worlds


@pytest.mark.slow
def test_workers_that_are_forked_repeat_what_a_seed_says() -> None:
    def after(seed: int) -> Tensor:
        env = ParallelEnv(2, randomised, mp_start_method="fork")
        env.set_seed(seed)
        return draws(env)

    assert torch.equal(after(5), after(5))
    assert not torch.equal(after(5), after(6))


@pytest.mark.slow
@pytest.mark.parametrize(("method", "env_seed"), [("fork", 5), ("spawn", 5), ("spawn", None)])
def test_a_job_that_seeds_itself_is_the_same_in_each_worker(method: str, env_seed: int | None) -> None:
    context = multiprocessing.get_context(method)
    with ProcessPoolExecutor(1, context) as first, ProcessPoolExecutor(1, context) as second:
        found = [pool.submit(seeded_job, env_seed).result() for pool in (first, second)]
    assert found[0] == found[1] == seeded_job(env_seed)


def seeded_job(env_seed: int | None) -> list[float]:
    """Theta of worlds, and global numbers after it."""
    torch.manual_seed(3)
    env = randomised()
    if env_seed is not None:
        env.set_seed(env_seed)
    return [*env.reset()["theta"].flatten().tolist(), *torch.rand(2).tolist()]


def test_workers_have_seeds_of_their_own_and_the_parent_none() -> None:
    torch.manual_seed(0)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        found = [pool.apply_async(worker_seed).get() for _ in range(2)]
    assert None not in found
    assert len(set(found)) == 2
    assert worker_seed() is None
