"""Each fault put into a table whose wiring was right is named with the line that mends it; effects are no faults."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism import Scope, Selection, compare, refine
from onlinebayes.criticism.inquiry import suspect
from onlinebayes.criticism.report import words
from onlinebayes.criticism.report.json import to_dict
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.wiring.faults import Compensated, Fault, Offset, Rescaled, Swapped, SwitchedOff, misplaced
from onlinebayes.criticism.wiring.hypotheses import hypotheses
from onlinebayes.criticism.wiring.wiring import Suspicion, fit_faults
from onlinebayes.identification.replaying.scoped import scoped
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.runs import Watch
from onlinebayes.simulators.effects import ActuatorDelay, ActuatorGain, ConstantLoad, DryFriction
from tests.criticism.wired import ARM, NOISE, PENDULUM, Rig

POSITION = "qpos.hinge"


def suspected(rig: Rig, measurement: Measurement) -> Suspicion | None:
    simulator, selection = rig.model(), Selection()
    base = ground(simulator, measurement, selection)
    return suspect(base, simulator, measurement, selection)


def sign(kind: str, *names: str) -> Rescaled:
    return Rescaled(kind, names, -1.0, "the reversed sign")


# fault that is put in, and the one that mends it
PENDULUM_FAULTS = {
    "sign": (sign("signal", POSITION), sign("signal", POSITION)),
    "degrees": (
        Rescaled("signal", (POSITION,), 180 / math.pi, ""),
        Rescaled("signal", (POSITION,), math.pi / 180, "degrees for radians"),
    ),
    "millivolts": (
        Rescaled("command", ("motor",), 1e3, ""),
        Rescaled("command", ("motor",), 1e-3, "thousandths (such as millivolts) for the unit itself"),
    ),
    "tenfold": (
        Rescaled("command", ("motor",), 10.0, ""),
        Rescaled("command", ("motor",), 0.1, "ten times too large"),
    ),
    "zero": (Offset(POSITION, -math.pi / 2), Offset(POSITION, math.pi / 2)),
}
ARM_FAULTS = {
    "sign of one joint": (sign("signal", "qpos.elbow"), sign("signal", "qpos.elbow")),
    "sign of a command": (sign("command", "lift"), sign("command", "lift")),
    "swapped joints": (Swapped("signal", ("qpos.shoulder",), ("qpos.elbow",)),) * 2,
    "swapped commands": (Swapped("command", ("lift",), ("bend",)),) * 2,
}


def check(rig: Rig, wrong: Fault, mends: Fault) -> None:
    measurement = rig.measure()
    found = suspected(rig, wrong.mended(measurement))
    assert found is not None
    assert found.fault == mends
    assert found.certain
    assert found.after < 0.05 * found.before


@pytest.mark.long
def test_what_degrees_leave_is_counted_in_the_sensors_own_sd() -> None:
    degrees = PENDULUM_FAULTS["degrees"][0].mended(PENDULUM.measure())
    signals = [replace(signal, sd=NOISE) for signal in degrees.signals]  # given in rad
    found = suspected(PENDULUM, replace(degrees, signals=tuple(signals)))
    assert found is not None
    assert found.left == pytest.approx(1.0, abs=0.2)


@pytest.mark.slow
def test_a_fault_does_not_explain_what_it_stills() -> None:
    """Divided by a thousand nothing moves by more than the sensor's noise, and nothing would be scored."""
    tenfold, simulator, selection = PENDULUM_FAULTS["tenfold"][0], PENDULUM.model(), Selection()
    measurement = tenfold.mended(PENDULUM.measure())
    base = ground(simulator, measurement, selection)
    stills = Rescaled("signal", (POSITION,), 1e-3, "millimetres for metres")
    assert fit_faults([(stills, base.fitted.theta)], base, simulator, measurement, selection) is None
    mends = (PENDULUM_FAULTS["tenfold"][1], base.fitted.theta)
    assert fit_faults([mends], base, simulator, measurement, selection) is not None


@pytest.mark.slow
@pytest.mark.parametrize("name", PENDULUM_FAULTS)
def test_faults_of_a_pendulum(name) -> None:
    check(PENDULUM, *PENDULUM_FAULTS[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", ARM_FAULTS)
def test_faults_of_an_arm(name) -> None:
    check(ARM, *ARM_FAULTS[name])


@pytest.mark.slow
def test_what_a_symmetric_machine_cannot_tell_apart_stands_beside() -> None:
    """A pendulum looks the same in the mirror: reversed command, or reversed angle."""
    found = suspected(PENDULUM, sign("command", "motor").mended(PENDULUM.measure()))
    assert found is not None
    assert found.fault == sign("signal", POSITION)
    assert found.equals == (sign("command", "motor"),)


@pytest.mark.slow
def test_an_actuator_that_was_off_in_a_run() -> None:
    off = SwitchedOff("lift", ("run1",))
    found = suspected(ARM, ARM.measure(off=off))
    assert found is not None
    assert found.fault == off
    assert found.certain


@pytest.mark.slow
def test_a_controller_that_carries_the_weight() -> None:
    found = suspected(ARM, ARM.measure(compensated=True))
    assert found is not None
    assert found.fault == Compensated(("lift", "bend"))
    assert found.certain


@pytest.mark.parametrize(
    ("effect", "size"),
    [
        (ActuatorGain("motor", Parameter(-0.9, 2.0)), 0.2),
        pytest.param(ActuatorDelay("motor", Parameter(0.0, 0.1, "s")), 0.015, marks=pytest.mark.slow),
        pytest.param(ConstantLoad("hinge", Parameter(-2.0, 2.0, "N m")), 0.5, marks=pytest.mark.slow),
        pytest.param(DryFriction("hinge", Parameter(0.0, 2.0, "N m")), 0.3, marks=pytest.mark.slow),
    ],
)
def test_effects_are_not_called_wiring(effect, size) -> None:
    assert suspected(PENDULUM, PENDULUM.measure({effect: (size,)})) is None


def test_nothing_is_simulated_where_the_model_agrees() -> None:
    simulator, measurement = PENDULUM.model(), PENDULUM.measure()
    base = ground(simulator, measurement, Selection())
    said: list[str] = []
    assert suspect(base, simulator, measurement, Selection(), Watch(said.append)) is None
    assert said == []


@pytest.fixture(scope="module")
def reversed_sign():
    return sign("signal", POSITION).mended(PENDULUM.measure(runs=10))


def test_the_verdict_and_the_report(reversed_sign) -> None:
    result = refine(PENDULUM.model(), reversed_sign, holdout=["run8", "run9"])
    assert result.verdict == "data_problem"
    assert result.accepted == ()
    assert result.wiring is not None
    assert result.wiring.lines == '[signals."qpos.hinge"]\nsign = -1'
    assert to_dict(result)["wiring"]["lines"] == result.wiring.lines
    assert "qpos.hinge: the reversed sign" in words.headline(result)


@pytest.mark.slow
def test_a_fault_that_no_replay_makes_plain_is_found_after_the_search() -> None:
    """An actuator off in one run, in which it did little: what effects leave shows it, and they are taken back."""
    off, said = SwitchedOff("lift", ("run3",)), []
    result = refine(
        ARM.model(), ARM.measure(off=off), candidates=["dry_friction", "actuator_gain"], progress=said.append
    )
    assert any(line.startswith("screening") for line in said)
    assert result.verdict == "data_problem"
    assert result.wiring is not None
    assert result.wiring.lines == off.lines
    assert result.accepted == ()
    assert not result.changed


@pytest.mark.slow
def test_parameters_that_differ_between_runs_do_not_hide_a_fault() -> None:
    damping = "joint.hinge.damping"
    measurement = sign("signal", POSITION).mended(PENDULUM.measure())
    simulator = scoped(PENDULUM.model(), Scope(per_run=(damping,)), measurement, measurement.runs)
    found = suspect(ground(simulator, measurement, Selection()), simulator, measurement, Selection())
    assert found is not None
    assert found.fault == sign("signal", POSITION)
    assert found.certain


@pytest.mark.slow
def test_compare_reports_the_fault(reversed_sign) -> None:
    result = compare(PENDULUM.model(), reversed_sign, holdout=["run8", "run9"])
    assert result.verdict == "data_problem"
    assert result.wiring is not None
    assert "qpos.hinge: the reversed sign" in words.wiring(result)


def test_mended_is_what_it_was() -> None:
    """Sign, swap and their like undo themselves; nothing else in the table changes, nor the table they were given."""
    measurement = ARM.measure(runs=2, seconds=0.5)
    before = measurement.data.clone()
    simulator = ARM.model()
    for fault in hypotheses(simulator, measurement):
        mended = fault.mended(measurement)
        assert bool((measurement.data == before).all())
        if isinstance(fault, Swapped) or (isinstance(fault, Rescaled) and fault.factor == -1.0):
            assert not bool((mended.data == before).all())
            assert bool((fault.mended(mended).data == before).all())


def test_a_factor_is_carried_by_the_floor() -> None:
    fault = Rescaled("signal", ("qpos.elbow",), -1e-3, "")
    assert fault.noise(("qpos.shoulder", "qpos.elbow"), torch.tensor([1.0, 2.0])).tolist() == pytest.approx([1.0, 2e-3])
    swapped = Swapped("signal", ("qpos.shoulder",), ("qpos.elbow",))
    assert swapped.noise(("qpos.shoulder", "qpos.elbow"), torch.tensor([1.0, 2.0])).tolist() == [2.0, 1.0]


@pytest.mark.slow
def test_a_zero_off_by_a_tooth_is_wiring_and_one_off_by_a_hundredth_an_effect() -> None:
    def verdict(offset: float) -> tuple[str | None, tuple[str, ...], str]:
        shifted = Offset(POSITION, offset).mended(PENDULUM.measure())
        found = refine(PENDULUM.model(), shifted, candidates=["sensor_bias", "dry_friction"])
        return found.verdict, found.accepted, found.wiring.lines if found.wiring else ""

    gross, accepted, lines = verdict(0.25)
    assert (gross, accepted) == ("data_problem", ())
    assert lines.startswith('[signals."qpos.hinge"]\noffset = -0.2')
    assert verdict(0.03) == ("missing_effect", ("sensor_bias@qpos.hinge",), "")


def test_only_the_largest_of_gross_offsets_is_looked_at() -> None:
    assert misplaced({}) is None
    assert misplaced({"qpos.a": 0.09}) is None
    assert misplaced({"qpos.a": 0.2, "qpos.b": -0.3}) == Offset("qpos.b", 0.3)
