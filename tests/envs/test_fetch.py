"""Fetch worlds are Gymnasium-Robotics' own, batched."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from envs.fetch import FRICTION, PHYSICAL, FetchSimulator, FetchTask, ScriptedPusher, motion, scene
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.simulators.testing import check_engine, check_env
from tests.envs.gymnasium_fetch import environments

robotics = pytest.importorskip("gymnasium_robotics")
WORLDS, STEPS = 16, 50
TASKS = ("reach", "push", "slide")
SPACE = ParameterSpace({FRICTION: PHYSICAL[FRICTION]})


@pytest.fixture
def reference():
    """Gymnasium-Robotics' environments."""
    with environments() as known:
        yield known


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_the_worlds_are_those_of_gymnasium_robotics(name, reference) -> None:
    made, generator = reference[name](), np.random.default_rng(0)
    place = scene(name)
    simulator, task = FetchSimulator(place, worlds=WORLDS), FetchTask(place)
    starts, paths, actions = [], [], generator.uniform(-1, 1, (WORLDS, STEPS, 4))
    for k in range(WORLDS):
        seen, _ = made.reset(seed=k)
        starts.append((made.data.qpos.copy(), made.data.qvel.copy(), seen["desired_goal"]))
        path = [seen]
        for t in range(STEPS):
            if k % 2:  # chase the object, or actions would never touch it
                actions[k, t, :3] = np.clip(10 * (path[-1]["achieved_goal"] - path[-1]["observation"][:3]), -1, 1)
            path.append(made.step(actions[k, t])[0])
        paths.append(path)
    qpos, qvel, goal = (torch.from_numpy(np.stack(rows)) for rows in zip(*starts, strict=True))
    state = simulator.reset(simulator.theta, TensorDict({"qpos": qpos, "qvel": qvel}, (WORLDS,)))
    for t in range(STEPS + 1):
        seen = task.exactly(state.set("task", TensorDict({"goal": goal}, (WORLDS,))))
        for key in ("observation", "achieved_goal", "desired_goal"):
            wanted = np.stack([path[t][key] for path in paths])
            np.testing.assert_allclose(seen[key].numpy(), wanted, rtol=0, atol=1e-12)
        if t < STEPS:
            command = task.command(torch.from_numpy(actions[:, t]))
            state = simulator.step(TensorDict({"command": command}, (WORLDS,)))


@pytest.mark.parametrize(("name", "friction"), [("push", 1.0), ("slide", 0.1)])
def test_the_nominal_friction_is_the_tasks_own_and_changes_nothing(name: str, friction: float) -> None:
    own, told = (FetchSimulator(scene(name), space) for space in (ParameterSpace({}), SPACE))
    assert told.nominal.tolist() == [friction]
    start = own.state
    told.reset(told.nominal[None], start)
    command = torch.tensor([[0.3, 0.2, -1.0]], dtype=torch.float64)
    for _ in range(10):
        states = [simulator.step(TensorDict({"command": command}, (1,))) for simulator in (own, told)]
    assert torch.equal(states[0]["qpos"], states[1]["qpos"])


@pytest.mark.parametrize("name", TASKS)
def test_starts_and_goals_spread_as_in_gymnasium_robotics(name, reference) -> None:
    made, task = reference[name](), FetchTask(scene(name))
    np.testing.assert_array_equal(made.initial_gripper_xpos, task.scene.grip)
    np.testing.assert_array_equal(made.initial_qpos, task.scene.qpos)
    state = task.start(torch.zeros(2000, 0, dtype=torch.float64), torch.Generator().manual_seed(0))
    goals = np.stack([made._sample_goal() for _ in range(2000)])
    for column in range(3):
        ours, theirs = state["task", "goal"][:, column].numpy(), goals[:, column]
        np.testing.assert_allclose([ours.min(), ours.max()], [theirs.min(), theirs.max()], atol=3e-3)


def test_the_fetch_worlds_are_an_engine() -> None:
    check_engine(FetchSimulator(scene("slide"), SPACE), commands=3, scale=0.5)
    check_env(lambda: SimulatorEnv(FetchSimulator(scene("push"), SPACE, worlds=4), FetchTask(scene("push"))))


def test_friction_is_of_the_table_too() -> None:
    """MuJoCo takes the larger friction: the object's alone would change nothing."""
    place, theta = scene("push"), torch.tensor([[0.1], [1.0]], dtype=torch.float64)
    simulator = FetchSimulator(place, SPACE, worlds=2)
    state = simulator.reset(theta)
    moving = state["qvel"].clone()
    moving[:, -6] = 1.0
    simulator.reset(theta, TensorDict({"qpos": state["qpos"], "qvel": moving}, (2,)))
    for _ in range(15):
        after = simulator.step(TensorDict({"command": torch.zeros(2, 3)}, (2,)))
    # v t - mu g t^2 / 2 at t = 0.6 s; with friction 1 it stands after v^2 / (2 g).
    way = (after["object"] - state["object"])[:, 0]
    torch.testing.assert_close(way, torch.tensor([0.424, 0.051], dtype=torch.float64), rtol=0.1, atol=0)


def test_the_lean_worlds_are_nearly_the_exact_ones() -> None:
    ends = []
    for lean in (False, True):
        simulator = FetchSimulator(scene("reach", lean), worlds=1)
        for k in range(10):
            state = simulator.step(TensorDict({"command": torch.tensor([[(-1.0) ** k, 0.5, -0.3]])}, (1,)))
        ends.append(state["grip"][0, :3])
    assert 0 < float((ends[0] - ends[1]).norm()) < 5e-3


def test_it_moves_to_a_process_of_its_own_as_it_stands() -> None:
    simulator = FetchSimulator(scene("slide"), SPACE, worlds=2)
    simulator.step(TensorDict({"command": torch.ones(2, 3)}, (2,)))
    inputs = TensorDict({"command": -torch.ones(2, 3)}, (2,))
    twin = pickle.loads(pickle.dumps(simulator))
    assert (twin.step(inputs) == simulator.step(inputs)).all()


def test_an_unknown_task_is_refused() -> None:
    with pytest.raises(BadInput, match="no Fetch task 'hover'"):
        scene("hover")


def test_the_scripted_pusher_reaches_its_goals() -> None:
    """In 64 lean worlds at least 60; a pusher that reaches .97 of them fails this with probability .03."""
    place = scene("push", lean=True)
    env, task = SimulatorEnv(FetchSimulator(place, SPACE, worlds=64), FetchTask(place)), FetchTask(place)
    end = env.rollout(50, ScriptedPusher(), break_when_any_done=False)["next"][:, -1]
    assert int(task.success(end["achieved_goal"], end["desired_goal"]).sum()) >= 60


def test_motion_is_seen_from_the_table() -> None:
    place = scene("push")
    simulator, task = FetchSimulator(place, worlds=1), FetchTask(place)
    start = task.start(simulator.theta, torch.Generator().manual_seed(0))
    qvel = start["qvel"].clone()
    qvel[:, -6] = 0.3
    state = simulator.reset(simulator.theta, start.set("qvel", qvel).exclude("task")).set("task", start["task"])
    moved = motion(task.exactly(state)["observation"])
    torch.testing.assert_close(moved[:, :3], state["object"][:, :3] - state["grip"][:, :3])
    torch.testing.assert_close(moved[:, 3:6], torch.tensor([[0.3, 0.0, 0.0]], dtype=torch.float64), atol=1e-2, rtol=0)
