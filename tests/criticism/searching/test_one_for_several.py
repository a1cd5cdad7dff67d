"""A law that can be the sum of those that were found before it takes their place, and of no others."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import Selection
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.one_for_several import put_one_for_several
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.stage import run_stage
from onlinebayes.criticism.searching.working_model import WorkingModel, with_effects
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import Interrupt, Watch
from onlinebayes.simulators.effects import AirDrag, ConstantLoad, Effect, GravityTilt, Wind
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.cases import refined

BALL = """
<mujoco><option timestep="0.01" integrator="RK4"/><worldbody><body name="ball">
  <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="0.2" diaginertia="1 1 1"/>
</body></worldbody><actuator><motor name="jet" joint="x"/></actuator></mujoco>"""
FREE = ParameterSpace({"body.ball.mass": Parameter(0.05, 1.0, "kg")})
NOISE = 1e-3
ALONG, UP = (ConstantLoad(joint, Parameter(-2.0, 2.0, "N")) for joint in "xz")
TILT = GravityTilt("world.x", Parameter(-0.5, 0.5, "rad"))
DRAG = AirDrag("ball", Parameter(0.0, 0.05))
BREEZE = Wind("ball.x", Parameter(0.0, 0.05), velocity=Parameter(-15.0, 15.0, "m/s"))


def model() -> MujocoSimulator:
    return MujocoSimulator(BALL, FREE, threads=1)


def thrown(effects: dict[Effect, tuple[float, ...]], runs: int = 8) -> Measurement:
    """Throws of a second, each with another speed and another push of the jet, with these effects hidden in them."""
    draw, rows = torch.Generator().manual_seed(0), 101
    simulator, theta = model(), [0.2]
    for effect, values in effects.items():
        simulator, theta = simulator.with_effect(effect), theta + list(values)
    time = 0.01 * torch.arange(rows, dtype=torch.float64)
    tone = 4.0 + 8.0 * torch.rand(runs, 1, generator=draw, dtype=torch.float64)
    command = 0.5 * torch.sin(tone * time)[..., None]
    qvel = 4.0 * (2 * torch.rand(runs, 2, generator=draw, dtype=torch.float64) - 1)
    start = TensorDict({"qpos": torch.zeros_like(qvel), "qvel": qvel}, batch_size=(runs,))
    path = simulator.rollout(
        torch.tensor(theta, dtype=torch.float64).expand(runs, -1),
        start,
        TensorDict({"command": command[:, :-1]}, batch_size=(runs, rows - 1)),
        time[1:],
    )["qpos"]
    seen = torch.cat([start["qpos"][:, None], path], 1)
    seen = seen + NOISE * torch.randn(seen.shape, generator=draw, dtype=seen.dtype)
    table = {
        f"run{r}": {
            "time": time.numpy(),
            "ctrl.jet": command[r, :, 0].numpy(),
            "qpos.x": seen[r, :, 0].numpy(),
            "qpos.z": seen[r, :, 1].numpy(),
        }
        for r in range(runs)
    }
    signals = [Signal(f"qpos.{joint}", "m", sd=NOISE) for joint in "xz"]
    return Measurement.from_runs(table, signals=signals, commands=["jet"])


def simpler(measurement: Measurement, found: list[Effect], watch: Watch | None = None) -> list[str] | None:
    """What takes the place of effects that were accepted one by one; None where they stay."""
    asked = SearchContext(measurement, Selection())
    base = ground(model(), measurement, asked.selection)
    working = WorkingModel(model(), base)
    for effect in found:
        now = working.grounds
        stage = run_stage(now.fitted, now.windows, [effect], now.numerics, asked.selection)
        working = with_effects(working, [(stage, stage.judged[0])], asked)
    assert working.at_floor(1.2)
    put = put_one_for_several(base, working, SearchContext(measurement, Selection(), watch=watch or Watch()), set())
    if put is None:
        return None
    assert put.at_floor(1.2)
    assert put.accepted[-1][1].admissible
    return [effect.key for effect in put.effects]


def test_a_tilt_takes_the_place_of_two_loads() -> None:
    measurement, said = thrown({TILT: (0.2,)}), list[str]()
    assert simpler(measurement, [ALONG, UP], Watch(said.append)) == [TILT.key]
    assert "looking whether gravity_tilt does what others do" in said
    stopped = Interrupt()
    stopped.requested = True
    assert simpler(measurement, [ALONG, UP], Watch(print, stopped)) is None


def test_two_loads_that_are_no_tilt_stay() -> None:
    assert simpler(thrown({ALONG: (0.4,), UP: (0.1,)}), [ALONG, UP]) is None


def test_a_wind_takes_the_place_of_a_drag_and_a_load_beside_another() -> None:
    found = simpler(thrown({BREEZE: (0.0006, 2.5), UP: (0.2,)}), [UP, DRAG, ALONG])
    assert found == [UP.key, BREEZE.key]


def test_a_drag_in_still_air_stays() -> None:
    assert simpler(thrown({DRAG: (0.001,)}), [DRAG]) is None


@pytest.mark.parametrize(
    ("seed", "accepted"),
    [
        pytest.param(2201, ("gravity_tilt@world.x",), marks=pytest.mark.long),
        pytest.param(2202, ("wind@ball.x",), marks=pytest.mark.long),
        pytest.param(2329, ("constant_load@y", "wind@ball.x"), marks=pytest.mark.long),
    ],
)
def test_a_thrown_balls_one_law_is_not_called_two(seed: int, accepted: tuple[str, ...], tmp_path) -> None:
    result, _ = refined("thrown_ball", "effect", seed, tmp_path)
    assert result.accepted == accepted
    assert result.verdict == "missing_effect"
