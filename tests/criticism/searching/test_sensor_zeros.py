"""An encoder's zero: half a milliradian is not given to a constant load, a real load is not given to the zero."""

import pytest
import torch

from envs.driven_pendulum.rig import DAMPING, MASS, MODEL, NOMINAL
from envs.driven_pendulum.sets import Encoder, Protocol, record
from onlinebayes.criticism import Criticism, Scope, refine
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.sensor_zeros import LARGEST_ZERO_FLOORS, zero_errors
from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import NOISE, measure, model

FREE = ParameterSpace({MASS: Parameter(0.1, 1.0, "kg"), DAMPING: Parameter(0.0, 0.1, "N m s/rad")})
FEW = ["dry_friction", "constant_load"]
ZERO = 5e-4  # rad
WEIGHT = NOMINAL[MASS] * 9.81 * 0.3  # N m / rad, of the bob at small angles


def swung(zero: float = 0.0, load: float = 0.0, runs: int = 8) -> Measurement:
    """A gentle swing, read with a zero error [rad], pushed by a torque [N m] that the table leaves out."""
    encoder = Encoder(sd=3e-5, resolution=1.5708e-4)
    protocol = Protocol(fit=runs, held=0, seconds=3.0, encoder=encoder, swing=(0.3, 0.6))
    (made,) = record([(NOMINAL, 3)], protocol)
    table = {
        f"run{k}": {
            "time": made.times.numpy(),
            "ctrl.motor": (made.command[k] - load).numpy(),
            "qpos.hinge": (made.angle[k] + zero).numpy(),
        }
        for k in range(runs)
    }
    signal = Signal("qpos.hinge", "rad", sd=encoder.sd, resolution=encoder.resolution)
    return Measurement.from_runs(table, signals=[signal], commands=["motor"])


def mended(measurement: Measurement, scope: Scope | None = None) -> Criticism:
    return refine(MujocoSimulator(MODEL, FREE, threads=1), measurement, candidates=FEW, scope=scope)


def test_a_zero_error_is_not_given_to_a_load() -> None:
    """Nothing is named: which of the two stands first in the tie, the last digits decide."""
    result = mended(swung(zero=ZERO))
    assert result.verdict == "tie"
    (row,) = (c for c in result.candidates if c.accepted)
    assert {row.effect, *row.indistinguishable_from} == {"constant_load@hinge", "sensor_bias@qpos.hinge"}
    (zero,) = (c for c in result.candidates if c.effect == "sensor_bias@qpos.hinge")
    bias = zero.parameters["bias"]
    assert bias.mean == pytest.approx(ZERO, abs=max(4 * bias.sd, 5e-6))
    (note,) = (note for note in result.notes if "offset" in note)
    assert f'[signals."qpos.hinge"] offset = {-bias.mean:.4g}' in note


@pytest.mark.slow
def test_a_zero_error_of_each_run_is_a_rival_too() -> None:
    """With one zero a run there are more numbers than one load has: the load stands, the zeros are judged beside it."""
    result = mended(swung(zero=ZERO), Scope(per_run=("sensor_bias@qpos.hinge",)))
    assert result.accepted == ("constant_load@hinge",)
    (zero,) = (c for c in result.candidates if c.effect == "sensor_bias@qpos.hinge")
    for bias in zero.parameters.values():
        assert bias.mean == pytest.approx(ZERO, abs=max(4 * bias.sd, 2e-5))


@pytest.mark.slow
def test_a_load_that_no_zero_explains_is_named() -> None:
    load = 10 * ZERO * WEIGHT
    result = mended(swung(load=load))
    assert result.accepted == ("constant_load@hinge",)
    assert result.verdict == "missing_effect"
    assert result.parameters["constant_load@hinge.load"].mean == pytest.approx(load, rel=0.01)


def test_zeros_are_bounded_by_the_floor() -> None:
    base = ground(model(), measure(runs=2), Selection())
    (bias,) = zero_errors(base.fitted, base.windows)
    assert bias.key == "sensor_bias@qpos.rail"
    assert bias.bias == Parameter(-LARGEST_ZERO_FLOORS * NOISE, LARGEST_ZERO_FLOORS * NOISE, "m")
    grown = model().with_effect(bias)
    fitted = ground(grown, measure(runs=2), Selection()).fitted
    assert zero_errors(fitted, base.windows) == []
    assert torch.isfinite(fitted.theta).all()
