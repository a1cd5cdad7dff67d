"""The order of the search: when it goes on, and when it ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import pytest

from onlinebayes.criticism import Selection
from onlinebayes.criticism.searching import search as search_module
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.search import ground, search
from tests.criticism.rigs import measure, model


@pytest.mark.usefixtures("without_shape_checks")
def test_it_goes_on_after_one_effect_took_anothers_place_and_not_in_circles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounds of which each leaves these effects: the third is new, the fourth has been there."""
    left: Iterator[list[str]] = iter([["a"], ["b"], ["b", "c"], ["b"], ["d"]])
    taken: list[list[str]] = []

    def extended(asked, working, added):
        taken.append(next(left))
        accepted = tuple((None, SimpleNamespace(effect=SimpleNamespace(key=key))) for key in taken[-1])
        return replace(working, accepted=accepted)

    monkeypatch.setattr(search_module, "_round", lambda *_: None)
    monkeypatch.setattr(search_module, "excluded", lambda *_: None)
    monkeypatch.setattr(search_module, "_chosen", lambda *_: ["something"])
    monkeypatch.setattr(search_module, "_extended", extended)
    data = measure(runs=8)
    base = ground(model(), data, Selection())
    found = search(model(), SearchContext(data, Selection(), ["dry_friction"]), 6, base)
    assert taken == [["a"], ["b"], ["b", "c"], ["b"]]
    assert [judged.effect.key for _, judged in found.accepted] == ["b"]


@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize(("believed", "noise"), [(False, False), (False, True), (True, False)])
def test_what_stood_on_trial_and_left_more_than_noise_is_kept_as_taken_back(
    monkeypatch: pytest.MonkeyPatch, believed: bool, noise: bool
) -> None:
    trial = (None, SimpleNamespace(effect=SimpleNamespace(key="cogging@rail")))
    found_last: Iterator[object] = iter([SimpleNamespace(added=[trial], believed=believed), None])
    floors: Iterator[bool] = iter([False, False, False, noise, noise, noise, noise])
    monkeypatch.setattr(search_module, "_round", lambda *_: None)
    monkeypatch.setattr(search_module, "excluded", lambda *_: None)
    monkeypatch.setattr(search_module, "_chosen", lambda *_: [])
    monkeypatch.setattr(search_module, "flexible_groups", lambda *_: ())
    monkeypatch.setattr(search_module, "_latest", lambda *_: next(found_last))
    monkeypatch.setattr(search_module, "_extended", lambda _, working, added: replace(working, accepted=tuple(added)))
    monkeypatch.setattr(search_module, "merge_confounded", lambda *_: None)
    monkeypatch.setattr(search_module, "eliminate", lambda working, _: working)
    monkeypatch.setattr(search_module, "_simplest", lambda context, base, working, alone: working)
    monkeypatch.setattr(search_module.WorkingModel, "at_floor", lambda *_: next(floors))
    data = measure(runs=8)
    base = ground(model(), data, Selection())
    found = search(model(), SearchContext(data, Selection()), 6, base)
    goes = not (believed or noise)
    assert found.taken_back == ((trial,) if goes else ())
    assert found.accepted == (() if goes else (trial,))
