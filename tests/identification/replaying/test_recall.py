"""Heat at the windows' starts, from what was measured of the run before; what a fit makes of it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

import onlinebayes.identification.replaying.recall as recall_module
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fitting.per_run_values import held_out_model
from onlinebayes.identification.replaying.recall import recall
from onlinebayes.identification.replaying.replay import history_rows
from onlinebayes.identification.replaying.scoped import ScopedSimulator, unfold
from onlinebayes.identification.scope import Scope
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import SensorScale, ThermalDerating
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, SLIDE, TRUTH, commands

HEAT = ThermalDerating("motor", Parameter(0.0, 5.0), Parameter(0.1, 50.0, "s", scale="log"), 8.0)
HOT = (1.5, 2.0)
THETA = torch.tensor([*TRUTH, *HOT]).double()
RUNS, SECONDS, STEP, NOISE = 4, 8.0, 0.01, 1e-4
ROWS = round(SECONDS / STEP) + 1
SERVO = SLIDE.replace('<motor name="motor" joint="rail"/>', '<position name="motor" joint="rail" kp="60" kv="6"/>')


def rig(xml: str = SLIDE) -> Identifiable:
    return MujocoSimulator(xml, FREE, threads=1).with_effect(HEAT)


def simulated(simulator: Identifiable, scale: float = 1.0) -> tuple[torch.Tensor, TensorDict]:
    """Commands (runs, rows) and the trajectories from rest and cold, row 0 included."""
    command = scale * commands(RUNS, ROWS, STEP, 0)
    rest = TensorDict({key: torch.zeros(RUNS, 1).double() for key in ("qpos", "qvel")}, batch_size=[RUNS])
    rest["effects", HEAT.key] = HEAT.rest(RUNS, STEP, rest["qpos"])
    inputs = TensorDict({"command": command[:, :-1]}, batch_size=[RUNS, ROWS - 1])
    times = STEP * torch.arange(1, ROWS).double()
    path = simulator.rollout(THETA.expand(RUNS, -1), rest, inputs, times).select("qpos", "qvel", "effects")
    return command[..., 0], TensorDict.cat([rest[:, None], path], dim=1)


def read(command: torch.Tensor, path: TensorDict, every: int = 1, gap: tuple[int, int] = (0, 0)) -> Measurement:
    """What a noisy encoder read off every so many rows, none of the log's in the gap."""
    draw, kept = np.random.default_rng(1), [k for k in range(ROWS) if not gap[0] <= k < gap[1]]
    angle = path["qpos"][..., 0].numpy() + NOISE * draw.standard_normal((RUNS, ROWS))
    angle[:, [k for k in range(ROWS) if k % every]] = np.nan
    table = {
        f"run{r}": {
            "time": STEP * np.array(kept),
            "ctrl.motor": command[r].numpy()[kept],
            "qpos.rail": angle[r][kept],
        }
        for r in range(RUNS)
    }
    return Measurement.from_runs(table, signals=[Signal("qpos.rail", "m", sd=NOISE)], commands=["motor"])


@pytest.fixture(scope="module")
def driven() -> tuple[torch.Tensor, TensorDict]:
    return simulated(rig())


@pytest.fixture(scope="module")
def served() -> tuple[torch.Tensor, TensorDict]:
    # A force stage holds forces over a timestep, by half of which a coarse simulation's heat lags.
    return simulated(rig(SERVO).with_timestep(0.002), 0.05)


def heat_of(simulator: Identifiable, windows: Windows, theta: torch.Tensor = THETA) -> torch.Tensor:
    physics, unfolded = unfold(simulator, windows, theta[None])
    return recall(physics, windows, unfolded)[HEAT.key]["heat"]


def heat_at(path: TensorDict, windows: Windows, every: int = 1) -> torch.Tensor:
    return path["effects", HEAT.key, "heat"][windows.run, windows.first * every]


def test_heat_at_the_windows_starts_is_that_of_the_whole_run(driven: tuple[torch.Tensor, TensorDict]) -> None:
    command, path = driven
    windows = make_windows(rig(), read(command, path), 1.0)
    truth = heat_at(path, windows)
    assert float(truth.max()) > 0.5
    torch.testing.assert_close(heat_of(rig(), windows), truth, rtol=0.0, atol=1e-9)
    assert history_rows(rig(), windows, [HEAT.key]) == 0


def test_a_short_memory_is_recalled_from_the_rows_before_each_window(
    driven: tuple[torch.Tensor, TensorDict], monkeypatch: pytest.MonkeyPatch
) -> None:
    quick = ThermalDerating("motor", HEAT.coefficient, Parameter(0.01, 0.2, "s", scale="log"), HEAT.reference)
    simulator = MujocoSimulator(SLIDE, FREE, threads=1).with_effect(quick)
    windows = make_windows(simulator, read(*driven), 1.0)
    theta = torch.tensor([*TRUTH, 1.5, 0.05]).double()
    rows: list[int] = []
    whole = type(simulator).hidden_states_along

    def counted(self: MujocoSimulator, worlds: torch.Tensor, motion: TensorDict, step: float) -> dict[str, TensorDict]:
        rows.append(motion.batch_size.numel())
        return whole(self, worlds, motion, step)

    monkeypatch.setattr(type(simulator), "hidden_states_along", counted)
    sliced = heat_of(simulator, windows, theta)
    monkeypatch.setattr(recall_module, "SLICED", 0.0)
    along = heat_of(simulator, windows, theta)
    assert rows[0] == windows.count * round(5 * 0.2 / STEP)  # five of the longest time constants
    assert rows[1] == RUNS * int(windows.first.max())
    assert float(along.max()) > 0.5
    torch.testing.assert_close(sliced, along, rtol=0.0, atol=1e-8)  # exp(-1 / 0.05) is forgotten


@pytest.mark.parametrize("every", [1, 3])
def test_a_servos_heat_follows_from_the_measured_motion(served: tuple[torch.Tensor, TensorDict], every: int) -> None:
    command, path = served
    windows = make_windows(rig(SERVO), read(command, path, every), 1.0)
    truth = heat_at(path, windows, round(windows.step / STEP))
    assert float(truth.max()) > 0.2
    torch.testing.assert_close(heat_of(rig(SERVO), windows), truth, rtol=0.02, atol=0.005)


def test_heat_goes_on_over_a_gap_of_the_log(served: tuple[torch.Tensor, TensorDict]) -> None:
    command, path = served
    windows = make_windows(rig(SERVO), read(command, path, gap=(300, 330)), 1.0)
    truth = heat_at(path, windows)
    # A gap of 0.3 s makes up 1 - exp(-0.3 / 2) = 14 % of the heat right after it; its commands are known by half.
    torch.testing.assert_close(heat_of(rig(SERVO), windows), truth, rtol=0.07, atol=0.005)


def test_a_sensors_scale_is_taken_off_the_motion(served: tuple[torch.Tensor, TensorDict]) -> None:
    command, path = served
    scale = SensorScale("qpos.rail", Parameter(-0.5, 0.5))
    shown = path.clone()
    shown["qpos"] = 1.2 * path["qpos"]
    simulator = rig(SERVO).with_effect(scale)
    windows = make_windows(simulator, read(command, shown), 1.0)
    heat = heat_of(simulator, windows, torch.cat([THETA, torch.tensor([0.2]).double()]))
    torch.testing.assert_close(heat, heat_at(path, windows), rtol=0.02, atol=0.005)


def test_every_run_has_its_own_theta(driven: tuple[torch.Tensor, TensorDict]) -> None:
    measurement = read(*driven)
    simulator = ScopedSimulator(rig(), Scope((f"{HEAT.key}.time_constant",)), measurement.runs)
    windows = make_windows(simulator, measurement, 1.0)
    times = torch.tensor([0.5, 1.0, 2.0, 4.0]).double()
    heat = heat_of(simulator, windows, torch.cat([THETA[:3], times]))
    for r, time in enumerate(times):
        alone = windows.select((windows.run == r).nonzero()[:, 0])
        mine = heat_of(rig(), alone, torch.cat([THETA[:3], time[None]]))
        torch.testing.assert_close(heat[windows.run == r], mine, rtol=0.0, atol=1e-12)


def test_halves_of_a_held_out_run_remember_the_whole_of_it(driven: tuple[torch.Tensor, TensorDict]) -> None:
    measurement = read(*driven)
    fitted = ("run0", "run1")
    simulator = ScopedSimulator(rig(), Scope(("body.cart.mass",)), fitted)
    windows = make_windows(simulator, measurement.select(["run2", "run3"]), 1.0)
    phi = torch.cat([THETA[:1], THETA]).double()
    halved, parts, values = held_out_model(simulator, windows, phi)
    truth = driven[1]["effects", HEAT.key, "heat"][windows.run + 2, windows.first]
    torch.testing.assert_close(heat_of(halved, parts, values), truth, rtol=0.0, atol=1e-9)


def test_a_run_whose_motion_is_not_known_is_replayed(served: tuple[torch.Tensor, TensorDict]) -> None:
    measurement = read(*served)
    few = torch.arange(ROWS)
    measurement.data["measured"] &= ((few >= 500) & (few < 504))[:, None]
    windows = make_windows(rig(SERVO), measurement, 1.0, memory=8.0)
    simulator, theta = unfold(rig(SERVO), windows, THETA[None])
    assert recall(simulator, windows, theta) == {}
    assert history_rows(simulator, windows) == int(windows.first.max()) > 0


@pytest.mark.slow
def test_a_fit_recovers_the_time_constant_of_a_motor_that_heats(driven: tuple[torch.Tensor, TensorDict]) -> None:
    windows = make_windows(rig(), read(*driven), 1.0)
    begin = torch.tensor([*TRUTH, 0.3, 5.0]).double()
    found = fit(rig(), windows, begin)
    torch.testing.assert_close(found.theta[2:], THETA[2:], rtol=0.02, atol=0.0)
