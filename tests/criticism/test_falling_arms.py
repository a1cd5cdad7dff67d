"""Wiring faults of arms that fall: over a whole window every replay is wrong, over its first quarter they show."""

from __future__ import annotations

import pytest

from tests.criticism.cases import refined


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
