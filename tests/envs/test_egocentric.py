"""A phone, its activities, and the choice of a sensor: exact rewards and charges, conformance, bad input."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs import Compose, TransformedEnv, check_env_specs

from envs.egocentric import (
    CURRENTS,
    MOTION,
    VISION,
    CameraCost,
    Phone,
    SensorChoice,
    Stretches,
    cross_fitted,
    features,
    gain,
    made_up,
    made_up_predictions,
    read_policy_run,
    read_predictions,
    read_sequences,
)
from envs.egocentric.battery_log import BatteryLog, charge_state, read_battery_log, write_battery_log
from onlinebayes.inference import BoxUniform
from onlinebayes.runs import BadInput
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.simulators.testing import check_engine, check_env
from onlinebayes.transforms import ParameterRandomization


class Listed:
    """In the place of a distribution: these, one a world."""

    def __init__(self, theta):
        self.theta = theta

    def sample(self, shape=(), generator=None):
        return self.theta


def some(number: int = 6, steps: int = 4) -> Stretches:
    """Stretches of other lengths, motion right in every second one."""
    length = torch.arange(number) % steps + 1
    there = torch.arange(steps) < length[:, None]
    right = (torch.arange(number)[:, None] % 2 == 0).expand(number, steps) & there
    rate = torch.full((number, steps), 0.8) * there
    return Stretches(torch.randn(number, steps, 3), right, rate, length, torch.arange(number))


def test_a_phone_is_an_engine() -> None:
    check_engine(Phone(), 1)


def test_charge_falls_by_the_currents_and_stops_at_zero() -> None:
    phone = Phone(2, dt=3600.0, capacity=1000.0)
    theta = torch.tensor([[150.0, 300.0], [600.0, 1200.0]], dtype=torch.float64)
    phone.reset(theta)
    command = torch.tensor([[0.5], [1.0]])
    state = phone.step(TensorDict({"command": command}, (2,)))
    assert state["qpos"].squeeze(-1).tolist() == [700.0, 0.0]
    assert state["qvel"].squeeze(-1).tolist() == [-300.0, -1000.0]
    assert state["clock"].squeeze(-1).tolist() == [3600.0, 3600.0]


def test_the_environment_keeps_every_promise() -> None:
    played = some(9, 9)
    check_env(lambda: SimulatorEnv(Phone(4), SensorChoice(played), seed=3))
    env = TransformedEnv(
        SimulatorEnv(Phone(4), SensorChoice(some())),
        Compose(ParameterRandomization(BoxUniform(CURRENTS)), CameraCost()),
    )
    check_env_specs(env)


@pytest.mark.gpu
def test_the_environment_lives_on_a_gpu() -> None:
    env = SimulatorEnv(Phone(4, device="cuda"), SensorChoice(some().to("cuda")))
    data = TransformedEnv(env, CameraCost()).rollout(6, break_when_any_done=False)
    assert data["next", "reward"].device.type == data["cost"].device.type == "cuda"


def told(task: SensorChoice, right: bool, trade_off: float, price: float, stretch: int) -> TensorDict:
    """A state in the first second of a stretch."""
    leaves = {
        "stretch": torch.tensor([stretch]),
        "vision_right": torch.full((1, task.horizon), right),
        "trade_off": torch.tensor([[trade_off]], dtype=torch.float64),
        "price": torch.tensor([[price]], dtype=torch.float64),
    }
    values = {"qpos": torch.tensor([[10.0]], dtype=torch.float64), "clock": torch.zeros(1, 1).double()}
    return TensorDict({**values, "task": leaves}, (1,))


@pytest.mark.parametrize(
    ("action", "motion", "vision", "worth"),
    [
        (MOTION, True, True, 1.0),
        (MOTION, False, True, -1.0),
        (VISION, False, True, 1.25),
        (VISION, True, True, 0.25),
        (VISION, True, False, -1.25),
        (VISION, False, False, -1.0),
    ],
)
def test_the_reward_is_that_of_equation_3_1_less_the_price(action, motion, vision, worth) -> None:
    task = SensorChoice(some())
    state = told(task, vision, 0.25, 2.0, stretch=0 if motion else 1)
    after = state.clone().set("qpos", state["qpos"] - 0.125)
    assert task.reward(state, torch.tensor([action]), after).tolist() == [worth - 2.0 * 0.125]


def test_the_gain_is_the_expected_difference_of_the_rewards() -> None:
    task, outcomes = SensorChoice(some()), torch.tensor([0.1, 0.4, 0.2, 0.3])
    expected = 0.0
    for k, probability in enumerate(outcomes.tolist()):
        state = told(task, bool(k % 2), 0.25, 0.0, stretch=0 if k >= 2 else 1)
        worth = [float(task.reward(state, torch.tensor([action]), state)) for action in (MOTION, VISION)]
        expected += probability * (worth[1] - worth[0])
    assert float(gain(outcomes, 0.25)) == pytest.approx(expected)


def test_episodes_end_with_their_stretch_or_an_empty_battery() -> None:
    env = SimulatorEnv(Phone(64), SensorChoice(some()), seed=1)
    data = env.rollout(4, break_when_any_done=False)
    first = data["next", "done"].squeeze(-1).long().argmax(1) + 1
    stretch = env.reset()  # draws anew; lengths 1 to 4 all occur
    assert sorted(first.unique().tolist()) == [1, 2, 3, 4]
    task = SensorChoice(some())
    empty = told(task, True, 0.0, 0.0, stretch=3).set("qpos", torch.zeros(1, 1).double())
    assert task.terminated(empty).tolist() == [True]
    assert stretch["observation"].shape == (64, 4)


def test_a_camera_second_costs_what_the_price_says_where_the_battery_empties_fast() -> None:
    env = SimulatorEnv(Phone(3), SensorChoice(some(), cost=(1.5, 1.5)))
    theta = torch.tensor([[100.0, 200.0], [200.0, 400.0], [300.0, 1000.0]], dtype=torch.float64)
    own, believed = (
        TransformedEnv(env, Compose(ParameterRandomization(Listed(theta)), CameraCost())),
        CameraCost(theta[0]),
    )
    start = own.reset()
    torch.testing.assert_close(start["cost"], torch.full((3, 1), 1.5))
    torch.testing.assert_close(believed(start.clone())["cost"], 1.5 * 200.0 / theta[:, 1:].float())
    step = env.rand_step(start)
    used = torch.where(step["action"] == VISION, theta.sum(1), theta[:, 0]) / 3600
    assert env.simulator.state["qpos"].squeeze(-1).tolist() == pytest.approx((3000 - used).tolist())


def test_stretches_without_a_second_are_refused() -> None:
    with pytest.raises(BadInput, match="one second at least"):
        Stretches(
            torch.zeros(1, 2, 3), torch.zeros(1, 2).bool(), torch.zeros(1, 2), torch.tensor([0]), torch.zeros(1).long()
        )


# --- data -----------------------------------------------------------------------------------------------------------


def test_no_predictor_sees_the_seconds_that_it_predicts_or_the_test_seconds() -> None:
    sequences, seen = made_up(40), []

    class Told(torch.nn.Module):
        def __init__(self, signals):
            super().__init__()
            self.signals = signals

        def forward(self, signals):
            common = (signals.flatten(1)[:, None] == self.signals.flatten(1)).all(-1).any()
            seen.append(bool(common))
            return torch.zeros(len(signals), 20)

    fold = (torch.arange(40) % 4)[:, None].expand(40, 15)
    made = list(cross_fitted(sequences, fold, [0, 1], lambda signals, label: Told(signals)))
    assert len(made) == 2
    assert len(seen) == 8
    assert not any(seen)


def test_features_are_standardised_over_the_seconds_that_exist() -> None:
    sequences = made_up(30)
    row = features(sequences, torch.randn(30, 15, 20).log_softmax(-1))
    seen = row[sequences.there]
    torch.testing.assert_close(seen.mean(0), torch.zeros(32), atol=1e-4, rtol=0)
    torch.testing.assert_close(seen.std(0), torch.ones(32), atol=1e-4, rtol=0)
    assert not row[~sequences.there].any()


def test_made_up_predictions_know_every_activity() -> None:
    assert made_up_predictions(400).vision_rate().shape == (20,)
    with pytest.raises(BadInput, match="has no recorded row"):
        made_up_predictions(15).vision_rate()


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("run,time\n", "has no column 'sensor.accx'"),
        ("HEAD\nact01seq01,0,1,2,3,4,5,nan\n", "row 2 holds a value that is no number"),
        ("HEAD\nact01seq01,0,1\n", "row 2 has another number of columns"),
        ("HEAD\nact01seq01,0,1,2,3,4,5,6\n", "shorter than a second: act01seq01"),
        ("HEAD\nwalk,0,1,2,3,4,5,6\n", "does not name its activity"),
    ],
)
def test_a_wrong_table_of_signals_is_one_clear_line(tmp_path, rows, message) -> None:
    names = ",".join(f"sensor.{name}" for name in ("accx", "accy", "accz", "gyrx", "gyry", "gyrz"))
    path = tmp_path / "sensors.csv"
    path.write_text(rows.replace("HEAD", f"run,time,{names}"))
    with pytest.raises(BadInput, match=message):
        read_sequences(path)
    with pytest.raises(BadInput, match="is missing"):
        read_sequences(tmp_path / "none.csv")


def test_a_prediction_that_is_no_class_is_refused(tmp_path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text("window,pred,label,action_0motion_1vision\n0,3,20,1\n")
    with pytest.raises(BadInput, match=r"row 2: label = '20'; needs a whole number in 0..19"):
        read_policy_run(path)


def test_the_recorded_predictions_are_the_published_ones(data) -> None:
    found = read_predictions(data / "egocentric" / "predictions.csv")
    assert float(found.motion_right.float().mean()) == pytest.approx(0.6124, abs=5e-5)
    assert float(found.vision_right.float().mean()) == pytest.approx(0.8359, abs=5e-5)
    run = read_policy_run(data / "egocentric" / "policy_runs" / "82.45_0.12_0.88_policy_alpha_03_rows.csv")
    assert float((run.said == run.label).float().mean()) == pytest.approx(0.8245, abs=5e-5)


# --- a battery's log --------------------------------------------------------------------------------------------------


def battery_log(steps: int = 10) -> TensorDict:
    """One log without noise, the camera on in every second minute."""
    phone, task = Phone(dt=60.0), BatteryLog(steps)
    env = SimulatorEnv(phone, task)
    env.reset()
    command = (torch.arange(steps) % 2).float()
    rows = [env.rand_step(TensorDict({"action": torch.ones(1, 1) * u}, (1,))) for u in command]
    charge = torch.stack([row["next", "observation"] for row in rows], 1)
    first = charge[:, :1] + 150 / 60
    before = torch.cat([first, charge[:, :-1]], 1)
    return TensorDict(
        {"observation": before, "action": command[None, :, None], "next": {"observation": charge}}, (1, steps)
    )


def test_a_log_with_gaps_falls_into_its_stretches(tmp_path) -> None:
    log, path = battery_log(), tmp_path / "log.csv"
    assert charge_state(log["observation"][:, 0])["qpos"].dtype == torch.float64
    write_battery_log(path, log[0], 60.0, torch.arange(10) == 4)
    read = read_battery_log(path, 60.0)
    assert read["mask"].sum(1).tolist() == [3, 5]
    whole = log["observation"][0]
    torch.testing.assert_close(read["observation"][0, :3], whole[:3], atol=2e-3, rtol=0)
    torch.testing.assert_close(read["observation"][1, :5], whole[5:], atol=2e-3, rtol=0)
    assert read["action"][1, :5, 0].tolist() == [1, 0, 1, 0, 1]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0,100,0\n60,99,0\n90,98,0\n", "closer than 60 s"),
        ("0,100,0\n60,101,0\n", "the charge rises from 0 to 60 s; leave out the time on the charger"),
        ("0,100,0\n60,,\n120,98,0\n", "no two rows are 60 s apart"),
        ("0,100,0\n60,99,2\n", "a share of camera in 0..1"),
        ("0,many,0\n", "row 2: 0, many, 0"),
    ],
)
def test_a_log_that_cannot_be_used_is_one_clear_line(tmp_path, rows, message) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"time,charge,camera\n{rows}")
    with pytest.raises(BadInput, match=message):
        read_battery_log(path, 60.0)
