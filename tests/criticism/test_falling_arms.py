"""Wiring faults of arms that fall: over a whole window every replay is wrong, over its first quarter they show."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism import Selection
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.wiring.bench import SCREENED_PARTS, Bench, replay_rms, replay_rms_of_parts
from tests.criticism.cases import refined
from tests.criticism.wired import ARM


def test_the_error_over_a_part_is_that_of_windows_which_end_there() -> None:
    simulator, measurement, selection = ARM.model(), ARM.measure(runs=2), Selection()
    bench = Bench(simulator, measurement, selection.horizon_s, ground(simulator, measurement, selection))
    windows, thetas = bench.whole, bench.thetas()[:3]
    found = replay_rms_of_parts(bench.coarse, windows, thetas, windows.noise)
    assert torch.equal(found[0], replay_rms(bench.coarse, windows, thetas, windows.noise))
    for part, errors in zip(SCREENED_PARTS, found, strict=True):
        rows = round(part * windows.rows)
        ends = windows.observed.clone()
        ends[:, rows:] = False
        cut = replace(windows, observed=ends)
        torch.testing.assert_close(errors, replay_rms(bench.coarse, cut, thetas, windows.noise))


@pytest.mark.long
@pytest.mark.parametrize(
    ("rig", "seed", "says"),
    [
        ("six_joint_arm", 2015, "qpos.j2"),
        ("six_joint_arm", 2016, "compensates gravity"),
        ("two_link_arm", 3107, "qpos.shoulder"),  # as it stands it diverges whatever theta is
    ],
)
def test_it_is_named_before_any_effect_is_tried(rig, seed, says, tmp_path) -> None:
    result, stages = refined(rig, "wiring", seed, tmp_path)
    assert result.verdict == "data_problem"
    assert result.wiring is not None
    assert says in result.wiring.fault
    assert not any(stage.startswith("screening") for stage in stages)
