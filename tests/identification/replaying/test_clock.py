"""A model whose step does not divide the log's rows is integrated with one that does."""

import pytest
import torch

from onlinebayes.criticism import compare
from onlinebayes.identification.replaying.clock import in_step, restepped
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, SLIDE, TRUTH, measure, model


def rows_every(seconds: float) -> Measurement:
    time = torch.arange(20, dtype=torch.float64) * seconds
    table = {"run": {"time": time.numpy(), "ctrl.motor": time.numpy(), "qpos.rail": time.numpy()}}
    return Measurement.from_runs(table, signals=[Signal("qpos.rail", "m", sd=1e-4)], commands=["motor"])


@pytest.mark.parametrize(
    ("own", "row", "used"),
    [
        (2e-3, 5e-3, 1.25e-3),  # a third of a row has no end in decimals, a quarter has
        (4e-3, 5e-3, 2.5e-3),
        (1e-3, 5e-3, 1e-3),
        (1e-3, 1 / 60, 1 / 60 / 17),
        (8e-3, 5e-3, 5e-3),
        (1e-2, 5e-3, 1e-2),
        (2e-3, 5.04e-3 - 1e-3, 2e-3),  # the median of a clock that jitters
    ],
)
def test_steps_divide_rows(own: float, row: float, used: float) -> None:
    measurement = rows_every(row)
    stepped = in_step(model().with_timestep(own), measurement)
    assert stepped.timestep == pytest.approx(used, rel=1e-6)
    assert bool(restepped(model().with_timestep(own), stepped, measurement)) == (used != own)


def test_a_user_reads_which_step_is_used_and_why() -> None:
    measurement = rows_every(5e-3)
    given = [model().with_timestep(own) for own in (2e-3, 8e-3)]
    shorter, longer = (restepped(one, in_step(one, measurement), measurement)[0] for one in given)
    assert shorter == (
        "the log has a row every 0.005 s: that is no multiple of the model's timestep of 0.002 s, so the model is run "
        "in steps of 0.00125 s, 4 to a row"
    )
    assert longer.endswith("timestep of 0.008 s is no multiple of that, so the model is run in steps of 0.005 s")


@pytest.mark.slow
def test_a_coarse_model_finds_the_masses_of_a_log_whose_rows_it_missed() -> None:
    coarse = MujocoSimulator(SLIDE.replace('timestep="0.01"', 'timestep="0.004"'), FREE, threads=1)
    measurement = measure(runs=9)  # rows every 10 ms, commands held between them
    found = compare(coarse, measurement)
    assert any("no multiple of the model's timestep of 0.004 s" in note for note in found.notes)
    assert max(found.remainder.rms_over_floor.values()) < 1.04
    for name, true in zip(FREE, TRUTH, strict=True):
        # Two parameters, 5 sd by Student's t of 8 degrees: a false failure in 500 seeds.
        assert abs(found.parameters[name].mean - true) < 5 * found.parameters[name].sd
