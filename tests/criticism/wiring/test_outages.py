"""Actuators that were off for a while: found with their edges; what hits every window is no outage."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism import Selection, refine
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.wiring.bench import Bench
from onlinebayes.criticism.wiring.outages import Outage, outage, sudden
from onlinebayes.criticism.wiring.wiring import outages
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import DryFriction
from tests.criticism.wired import ARM, NOISE, PENDULUM, STEP, Rig

OFF = Outage(("motor",), (("run1", 0.72, 1.31), ("run4", 1.8, 2.6)))


def found(rig: Rig, measurement: Measurement) -> Outage | None:
    simulator, selection = rig.model(), Selection()
    bench = Bench(simulator, measurement, selection.horizon_s, ground(simulator, measurement, selection))
    seen = outage(bench.base, bench.coarse, bench.whole)
    return None if seen is None else seen[0]


def test_edges_are_found_where_the_command_was_large() -> None:
    """An edge at which the command passes through zero may lie anywhere beside it."""
    measured = PENDULUM.measure(off=OFF)
    seen = found(PENDULUM, measured)
    assert seen is not None
    assert seen.actuators == OFF.actuators
    assert [run for run, *_ in seen.spans] == [run for run, *_ in OFF.spans]
    for (run, *edges), (_, *true) in zip(seen.spans, OFF.spans, strict=True):
        command = measured.data["command"][measured.runs.index(run), :, 0]
        for edge, right in zip(edges, true, strict=True):
            between = slice(*sorted((round(edge / STEP), round(right / STEP))))
            lost = float(command[between].sum().abs()) * STEP  # N m s, of 1.2 N m for half a second and more
            assert lost < 0.05
            assert edge == pytest.approx(right, abs=0.15)


def test_a_machine_that_was_on_or_lacks_an_effect_has_none() -> None:
    assert found(PENDULUM, PENDULUM.measure()) is None
    assert found(PENDULUM, PENDULUM.measure({DryFriction("hinge", Parameter(0.0, 2.0, "N m")): (0.3,)})) is None


def test_windows_at_rest_make_no_misfit_sudden() -> None:
    """Five of eight runs hang still, where no model errs; in the others friction is missing all the time."""
    measured = PENDULUM.measure({DryFriction("hinge", Parameter(0.0, 2.0, "N m")): (0.3,)})
    data = measured.data.clone()
    data["command"][:5] = 0.0
    data["signal"][:5] = NOISE * torch.randn(data["signal"][:5].shape, generator=torch.Generator().manual_seed(0))
    rests = replace(measured, data=data)
    simulator, selection = PENDULUM.model(), Selection()
    bench = Bench(simulator, rests, selection.horizon_s, ground(simulator, rests, selection))
    assert int(bench.whole.observed.any(2).any(1).sum()) < bench.whole.count / 2
    assert not sudden(bench.base, bench.coarse, bench.whole)
    assert outage(bench.base, bench.coarse, bench.whole) is None


@pytest.mark.slow
def test_an_outage_that_strikes_every_window_shows_in_quarters_of_them() -> None:
    """Runs of two seconds, each off from 0.8 s to 1.2 s: both of its windows are struck."""
    off = Outage(("motor",), tuple((f"run{r}", 0.8, 1.2) for r in range(8)))
    measured, simulator, selection = PENDULUM.measure(off=off, seconds=2.0), PENDULUM.model(), Selection()
    base = ground(simulator, measured, selection)
    suspicion = outages(base, simulator, measured, selection)
    assert suspicion is not None
    assert isinstance(suspicion.fault, Outage)
    assert {run for run, *_ in suspicion.fault.spans} == {f"run{r}" for r in range(8)}
    assert all(0.7 < begin < end < 1.3 for _, begin, end in suspicion.fault.spans)
    assert suspicion.after < 0.2 * suspicion.before  # edges in quarters of a window are known to a row or two


def test_it_is_said_with_the_column_that_the_table_lacks() -> None:
    assert OFF.says == (
        "motor was off from 0.72 s to 1.31 s in run1, from 1.8 s to 2.6 s in run4, whatever the table commands"
    )
    assert OFF.lines == (
        "# in the table: enable.motor, 1 in every row, but 0 in\n#   run1: 0.72 to 1.31 s\n#   run4: 1.8 to 2.6 s"
    )


@pytest.mark.slow
def test_an_arm_that_was_off_for_a_while_is_a_data_problem() -> None:
    spans = tuple((f"run{r}", 1.2, 1.8) for r in range(8))
    off = Outage(("lift", "bend"), spans)
    result = refine(ARM.model(), ARM.measure(off=off), candidates=["dry_friction", "actuator_gain"])
    assert result.verdict == "data_problem"
    assert result.wiring is not None
    assert "lift and bend were off" in result.wiring.fault
    assert result.accepted == ()
