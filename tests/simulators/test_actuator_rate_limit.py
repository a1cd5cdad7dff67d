"""A limit on the rate of a command: the staircase that it lets through, what it carries on, and that it is found."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import least_squares
from tensordict import TensorDict

from onlinebayes.criticism import propose, refine
from onlinebayes.criticism.hypotheses.additions import AddedEffect
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import ActuatorRateLimit, Effect, Scales
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import measure, model
from tests.simulators.models import SLIDE
from tests.simulators.test_force_stage import Slider

H, MASS = 0.002, 2.0
EFFECT = ActuatorRateLimit("motor", Parameter(1.0, 1e6, "1/s", scale="log"), 10.0)


def _commands(steps: int, seed: int = 0) -> np.ndarray:
    """Steps up and down that hold for some timesteps, with a tone in between."""
    held = np.random.default_rng(seed).normal(size=-(-steps // 7)).repeat(7)[:steps]
    return 3.0 * held + np.sin(20.0 * H * np.arange(steps))


def _let_through(command: np.ndarray, limit: float, last: float = 0.0, h: float = H) -> np.ndarray:
    """The equation, timestep by timestep."""
    passed = []
    for u in command:
        last += min(max(u - last, -limit * h), limit * h)
        passed.append(last)
    return np.array(passed)


def _command(command: np.ndarray, limits: list[float], state: TensorDict | None = None):
    own = {"limit": torch.tensor(limits).double()}
    return EFFECT.command(own, state, torch.from_numpy(np.atleast_2d(command)), H)


def _roll(simulator: Simulator, limits: list[float], command: np.ndarray, start: TensorDict | None = None):
    rows, steps = len(limits), len(command)
    state = TensorDict({k: torch.zeros(rows, 1).double() for k in ("qpos", "qvel")}, batch_size=[rows])
    u = torch.from_numpy(command).reshape(1, steps, 1).expand(rows, -1, -1).contiguous()
    inputs = TensorDict({"command": u}, batch_size=[rows, steps])
    times = simulator.timestep * torch.arange(1, steps + 1, dtype=torch.float64)
    theta = torch.tensor(limits).double()[:, None]
    return simulator.rollout(theta, state if start is None else start, inputs, times)


def _backend(kind: str) -> Simulator:
    return (MujocoSimulator(SLIDE) if kind == "mujoco" else Slider()).with_effect(EFFECT)


@pytest.mark.parametrize("limit", [3.0, 60.0, 900.0, 9e5])
def test_what_is_let_through_is_the_equations_staircase(limit: float) -> None:
    command = _commands(300)
    passed, after = _command(command, [limit])
    np.testing.assert_allclose(passed[0], _let_through(command, limit), rtol=0, atol=1e-12)
    assert after is not None
    assert float(after["last"]) == float(passed[0, -1])


def test_it_climbs_and_falls_by_the_same_stairs_and_then_follows_bit_for_bit() -> None:
    command = np.repeat([1.0, -1.0, -0.9], [6, 8, 2])
    passed, _ = _command(command, [150.0])  # 0.3 a timestep
    up, down = [0.3, 0.6, 0.9, 1.0, 1.0, 1.0], [0.7, 0.4, 0.1, -0.2, -0.5, -0.8, -1.0, -1.0]
    assert passed[0].tolist() == pytest.approx([*up, *down, -0.9, -0.9], abs=1e-15)
    assert (passed[0] == torch.from_numpy(command))[[3, 4, 5, 12, 13, 14, 15]].all()
    mirrored, _ = _command(-command, [150.0])
    assert torch.equal(mirrored, -passed)


def test_each_world_has_its_own_limit() -> None:
    command, limits = _commands(120), [20.0, 400.0, 1e6]
    together, _ = _command(np.stack([command] * 3), limits)
    for row, limit in zip(together, limits, strict=True):
        assert torch.equal(row, _command(command, [limit])[0][0])
    # The last is at its upper bound, where nothing is limited: no rate of these commands would reach 1e6 anyway.
    assert torch.equal(together[2], torch.from_numpy(command))
    assert not torch.allclose(together[0], together[1])


def test_only_the_upper_bound_is_no_limit() -> None:
    tight = ActuatorRateLimit("motor", Parameter(1.0, 50.0))
    own = {"limit": torch.tensor([49.9, 50.0]).double()}
    command = torch.tensor([[1.0, -1.0]]).double().expand(2, -1)
    passed, _ = tight.command(own, None, command, H)
    assert passed.tolist() == [pytest.approx([0.0998, 0.0]), [1.0, -1.0]]


def test_a_trace_is_what_the_steps_would_leave() -> None:
    command = torch.from_numpy(np.stack([_commands(40), _commands(40, seed=1)]))
    own = {"limit": torch.tensor([30.0, 300.0]).double()}
    start = TensorDict({"last": torch.tensor([2.0, -1.0]).double()}, batch_size=[2])
    at_once, walked = EFFECT.trace(own, start, command, H), Effect.trace(EFFECT, own, start, command, H)
    assert at_once is not None
    assert walked is not None
    assert torch.equal(at_once["last"], walked["last"])
    np.testing.assert_allclose(at_once["last"][0], _let_through(command[0].numpy(), 30.0, 2.0), rtol=0, atol=1e-12)


@pytest.mark.parametrize("backend", ["mujoco", "torch"])
def test_the_last_command_is_carried_across_a_split_rollout(backend: str) -> None:
    simulator, command, limits = _backend(backend), _commands(200), [40.0, 700.0]
    whole = _roll(simulator, limits, command)
    first = _roll(simulator, limits, command[:90])
    second = _roll(simulator, limits, command[90:], first[:, -1].exclude("valid").clone())
    for key in ("qpos", "qvel", ("effects", EFFECT.key, "last")):
        assert torch.equal(torch.cat([first[key], second[key]], dim=1), whole[key])
    alone = _roll(simulator, limits[1:], command)
    assert torch.equal(alone["qpos"][0], whole["qpos"][1])


def test_both_backends_move_as_a_free_mass_under_the_staircase() -> None:
    command, limits = _commands(200), [40.0, 700.0]
    paths = [_roll(_backend(kind), limits, command) for kind in ("mujoco", "torch")]
    torch.testing.assert_close(paths[0]["qpos"], paths[1]["qpos"], rtol=0, atol=1e-12)
    for row, limit in enumerate(limits):
        speed = np.cumsum(_let_through(command, limit)) * H / MASS
        np.testing.assert_allclose(paths[0]["qvel"][row, :, 0], speed, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            paths[1]["effects", EFFECT.key, "last"][row], _let_through(command, limit), rtol=0, atol=1e-12
        )


def test_within_a_held_command_it_moves_at_every_timestep() -> None:
    simulator = MujocoSimulator(SLIDE, dt=5 * H).with_effect(EFFECT)
    simulator.reset(torch.tensor([[30.0]]).double())
    for k in (1, 2):
        state = simulator.step(TensorDict({"command": torch.ones(1, 1)}, batch_size=[1]))
        assert float(state["effects", EFFECT.key, "last"]) == pytest.approx(0.3 * k, rel=1e-12)


def test_what_was_commanded_before_is_forgotten_within_its_memory() -> None:
    # A window in mid-run: the commands of its memory, from rest, against all that were given. Twice the slowest limit.
    effect = ActuatorRateLimit("motor", Parameter(20.0, 1e6, scale="log"), 8.0)
    own, steps = {"limit": torch.tensor([40.0]).double()}, round(effect.memory / H)
    command = torch.from_numpy(np.clip(6.0 * np.sin(9.0 * H * np.arange(3 * steps)), -4.0, 4.0))[None]
    whole, half = effect.command(own, None, command, H)[0], effect.command(own, None, command[:, steps:], H)[0]
    assert not torch.allclose(whole[:, steps : steps + 3], half[:, :3])
    torch.testing.assert_close(whole[:, 2 * steps :], half[:, steps:], rtol=0, atol=1e-12)


def test_the_limit_of_a_torch_system_is_recovered() -> None:
    simulator, command = _backend("torch"), _commands(200)
    read = _roll(simulator, [150.0], command)["qpos"][0, :, 0].numpy()
    read = read + 1e-6 * np.random.default_rng(3).normal(size=read.shape)

    def wrong(log_limit: np.ndarray) -> np.ndarray:
        return (_roll(simulator, [math.exp(log_limit[0])], command)["qpos"][0, :, 0].numpy() - read) * 1e6

    found = least_squares(wrong, [math.log(400.0)], diff_step=1e-5)
    assert math.exp(found.x[0]) == pytest.approx(150.0, rel=1e-3)


@pytest.mark.slow
def test_a_search_that_is_asked_for_it_finds_it() -> None:
    hidden = {ActuatorRateLimit("motor", Parameter(1.0, 1e5, "1/s", scale="log"), 24.0): (40.0,)}
    # No command was given before the runs, as simulated.
    measured = replace(measure(hidden, runs=10), idle_before=True)
    result = refine(model(), measured, holdout=["run8", "run9"], candidates=["actuator_rate_limit"])
    assert (result.verdict, result.accepted) == ("missing_effect", (EFFECT.key,))
    assert result.parameters[f"{EFFECT.key}.limit"].mean == pytest.approx(40.0, rel=1e-2)


def test_it_is_tried_where_it_is_named_and_not_unasked() -> None:
    windows = make_windows(model(), measure(runs=2), 1.0)
    assert EFFECT.key not in {effect.key for effect in propose(model(), windows)}
    (named,) = propose(model(), windows, ["actuator_rate_limit"])
    assert named.key == EFFECT.key


def test_a_search_begins_near_its_starts_and_not_out_of_reach() -> None:
    # Of the straight line from no limit to a start, nearly all would move nothing, and a fit would stay there.
    windows = make_windows(model(), measure(runs=2), 1.0)
    (named,) = propose(model(), windows, ["actuator_rate_limit"])
    grown = model().with_effect(named)
    for start, first in zip(AddedEffect(named).starts(grown, {})[1:], named.starts, strict=True):
        ends = sorted(start.neutral + size * start.reach for size in (start.low, start.high))
        assert ends == pytest.approx([first["limit"] / 2, first["limit"] * 2])


def test_its_bounds_follow_from_the_commands_and_its_starts_lie_within() -> None:
    effect = ActuatorRateLimit.scaled("motor", Scales(force=4.0, speed=1.0, travel=1.0, time=0.1))
    assert (effect.limit.low, effect.limit.high) == (pytest.approx(4.0), pytest.approx(8000.0))
    assert effect.memory == pytest.approx(2.0)  # from -4 to 4 at 4 a second
    starts = [start["limit"] for start in effect.starts]
    assert starts == sorted(starts, reverse=True)
    assert effect.limit.low < starts[-1] < starts[0] < effect.limit.high


@pytest.mark.parametrize(("limit", "swing"), [((0.0, 1.0), 1.0), ((-1.0, 1.0), 1.0), ((0.1, 1.0), 0.0)])
def test_limits_that_let_nothing_through_are_refused(limit: tuple[float, float], swing: float) -> None:
    with pytest.raises(BadInput, match="stay above 0"):
        ActuatorRateLimit("motor", Parameter(*limit), swing)
