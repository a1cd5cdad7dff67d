"""What is sure and small is told, for the parameters may have taken it up."""

from __future__ import annotations

import pytest

from onlinebayes.criticism.findings.too_small import too_small_note
from onlinebayes.criticism.judging.acceptance import TOO_LITTLE
from onlinebayes.criticism.results import Candidate
from onlinebayes.identification.results import Estimate

SMALL = f"{TOO_LITTLE}: the cross-validated error falls by 2.4 %, not by 5 %"
LOAD = Estimate(-52.7, 2.4, -56.7, -48.7, "N m", True)


def candidate(effect: str, gain: float, *refused: str, p: float = 0.0002) -> Candidate:
    return Candidate(effect, 1, p, gain, 40.0, 8, refused_because=refused, parameters={"load": LOAD})


def test_the_surest_is_named_with_its_size_and_how_many_others_there_are() -> None:
    others = [candidate("sensor_bias@qpos.lift", 123.0, SMALL), candidate("dry_friction@lift", 3.0, SMALL, p=0.4)]
    (note,) = too_small_note([candidate("constant_load@lift", 128.0, SMALL), *others], 0.03)
    assert note.startswith("constant_load@lift (load -53 ± 2 N m), and 1 more as sure as that: hardly chance")
    assert "than 5 %" in note


@pytest.mark.parametrize("refused", [(), ("a patch, not a law: its size differs",), (SMALL, "weak evidence: gain 3")])
def test_nothing_is_said_of_what_is_accepted_or_fails_more(refused: tuple[str, ...]) -> None:
    assert too_small_note([candidate("constant_load@lift", 128.0, *refused)], 0.03) == ()
