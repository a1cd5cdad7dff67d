"""The first answer: how wrong the model is before anything is fitted."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import Selection, compare
from onlinebayes.identification.fitting.first_answer import first_answer
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import DryFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.wired import NOISE, PENDULUM

FALL = """
<mujoco><option timestep="0.002"/><worldbody><body name="box">
  <joint name="z" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/>
</body></worldbody></mujoco>"""
RIGHT = PENDULUM.xml.replace('damping="0.03"', 'damping="0.05"').replace('mass="1"', 'mass="1.2"')


def said(xml: str) -> str:
    return first_answer(MujocoSimulator(xml, PENDULUM.free, threads=1), PENDULUM.measure(runs=3), Selection())


def factor(sentence: str, joint: str = "hinge") -> float:
    return float(sentence.partition(f"in qpos.{joint}, ")[2].split()[0])


def test_a_right_model_errs_by_little_and_a_wrong_one_by_much() -> None:
    """From smoothed starts a right model errs by some floors too: its velocity is not known to the sensor's noise."""
    assert factor(said(RIGHT)) < 10
    wrong = said(PENDULUM.xml)
    assert factor(wrong) > 20
    size = 1e-3 * float(wrong.partition("errs by ")[2].split()[0])
    assert " mrad in qpos.hinge" in wrong
    assert size == pytest.approx(factor(wrong) * NOISE, rel=0.2)


def test_it_runs_at_its_own_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A log that the model itself wrote, by Euler's method: at a longer step the model would seem to err by more."""
    model = MujocoSimulator(FALL, threads=1)
    times = 0.01 * torch.arange(1, 200, dtype=torch.float64)
    rest = TensorDict({"qpos": torch.zeros(1, 1), "qvel": torch.zeros(1, 1)}, batch_size=(1,)).double()
    still = TensorDict({"command": torch.zeros(1, 199, 0).double()}, batch_size=(1, 199))
    z = model.rollout(torch.zeros(1, 0).double(), rest, still, times)["qpos"][0, :, 0]
    z = z + 1e-4 * torch.randn(199, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    table = {f"run{k}": {"time": times.numpy(), "qpos.z": z.numpy()} for k in range(2)}
    fall = Measurement.from_runs(table, signals=[Signal("qpos.z", "m", sd=1e-4)], commands=[])
    own = first_answer(model, fall, Selection())
    assert own.startswith("As it was given, the model errs by ")
    monkeypatch.setattr(sys.modules[first_answer.__module__], "MOST_STEPS", 500)
    longer = first_answer(model, fall, Selection())
    assert longer.startswith("As it was given, integrated in steps of 10 ms, the model errs by ")
    assert factor(longer, "z") > 2 * factor(own, "z")


def test_effects_that_were_added_are_said_to_do_nothing_yet() -> None:
    model = PENDULUM.model().with_effect(DryFriction("hinge", Parameter(0.0, 1.0, "N m")))
    assert first_answer(model, PENDULUM.measure(runs=3), Selection()).startswith(
        "With nothing fitted and added effects at"
    )


def test_a_model_that_diverges_is_said_to() -> None:
    unstable = PENDULUM.xml.replace('damping="0.03"', 'damping="0.03" stiffness="-1e9"')
    assert said(unstable).startswith("As it was given, the model diverges in ")


def test_of_a_machine_that_rests_nothing_is_said() -> None:
    measurement = PENDULUM.measure(runs=2)
    data = measurement.data.clone()
    data["signal"] = torch.zeros_like(data["signal"])
    assert first_answer(PENDULUM.model(), replace(measurement, data=data), Selection()) == ""


@pytest.mark.slow
def test_it_is_the_first_thing_that_is_said() -> None:
    lines: list[str] = []
    compare(PENDULUM.model(), PENDULUM.measure(runs=3), progress=lines.append)
    assert lines[0].startswith("As it was given, the model errs by ")
