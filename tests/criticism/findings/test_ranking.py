"""The order of the candidates, where something stood on trial."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from onlinebayes.criticism.candidates.survey import Screened
from onlinebayes.criticism.findings import ranking
from onlinebayes.criticism.judging.acceptance import Judged
from onlinebayes.criticism.results import HELPS
from onlinebayes.criticism.searching.search import SearchResult
from onlinebayes.criticism.searching.stage import Stage


def _effect(key: str) -> Any:
    return SimpleNamespace(key=key)


def test_what_was_taken_back_from_trial_stands_before_what_was_only_screened(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranking, "_own_estimates", lambda stage, judged: {})
    monkeypatch.setattr(ranking, "contained", lambda effect: set())

    def judged(key: str, gain: float, failed: tuple[str, ...]) -> Any:
        evidence = SimpleNamespace(gain=gain, se=2.0, blocks=12)
        return Mock(
            spec=Judged,
            effect=_effect(key),
            p_value=0.9,
            gain=evidence,
            falls=(0.62, 0.6),
            homogeneous=True,
            failed=failed,
        )

    def screened(key: str, p: float | None) -> Any:
        return Mock(
            spec=Screened, effect=_effect(key), p_value=p, z=1.0, promise=0.01, exclusion_limit=None, confounded_with=()
        )

    keys = ("dry_friction@table", "gravity_tilt@world.x", "viscous_friction@table", "cogging@table", "wind@world")
    weak = judged(keys[0], 3.0, ("weak evidence: 1",))
    last = Mock(
        spec=Stage,
        screened=(screened(keys[1], 0.6), screened(keys[2], None), screened(keys[0], 0.01)),
        judged=(weak,),
        blocks=SimpleNamespace(count=12),
    )
    trial = (Mock(spec=Stage, blocks=last.blocks), judged(keys[3], 80.0, ()))
    found: Any = Mock(
        spec=SearchResult,
        stages=(last,),
        accepted=(),
        effects=[_effect(key) for key in keys],
        interrupted=False,
        taken_back=(trial,),
    )
    rows = ranking.rank(found, {}, {})
    assert [(row.effect, row.rank) for row in rows] == [
        (keys[0], 1), (keys[3], 2), (keys[1], 3), (keys[2], None), (keys[4], None),
    ]  # fmt: skip
    assert rows[1].refused_because == (f"{HELPS}: the error falls by 62 %, and what is left is not noise",)
    assert (rows[1].score_gain, rows[1].rms_fall, rows[1].accepted) == (80.0, (0.62, 0.6), False)
    assert rows[4].refused_because == ("tried last: it does not leave noise",)
