"""The page: self-contained, well-formed, escaped, and right about each verdict."""

from __future__ import annotations

import dataclasses
import html
import re
from html.parser import HTMLParser

import pytest
import torch

from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.results import MOVES_NOTHING, HeldOutError, Remainder, WidenedBounds
from onlinebayes.identification.results import Estimate, FlatDirection
from onlinebayes.report import candidate_words, phrases, words
from onlinebayes.report.html import to_html
from onlinebayes.report.screen_lines import first_screen
from onlinebayes.report.sections.summary import sizes
from tests.report.synthetic import SIGNAL, changed, criticism

VOID = {"wbr", "meta", "br", "hr", "img", "link"}


class Balanced(HTMLParser):
    """Fails on a tag that closes another than the last one opened; collects what would reach out of the page."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.outside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("script", "link", "iframe", "img", "object"):
            self.outside.append(tag)
        self.outside += [
            f"{name}={value}"
            for name, value in attrs
            if name in ("src", "href", "onload", "onclick") and not (name == "href" and str(value).startswith("#"))
        ]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag


def check(page: str) -> str:
    """The visible text of a page that is balanced, reaches nothing outside, and holds no raw nan."""
    parser = Balanced()
    parser.feed(page)
    assert parser.open == []
    assert parser.outside == []
    assert not re.search(r"url\(|@import|https?://", page)
    text = re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)
    assert not re.search(r"\bnan\b|\binf\b", text)
    return html.unescape(re.sub(r"<[^>]+>", " ", text)).replace("\xa0", " ")


def bare(result: Criticism, **changes: object) -> Criticism:
    """The same with nothing accepted."""
    return dataclasses.replace(
        result, accepted=(), steps=(), final=result.base,
        candidates=tuple(dataclasses.replace(c, accepted=False) for c in result.candidates), **changes,
    )  # fmt: skip


def test_what_leaves_noise_alone_is_named_without_a_reservation() -> None:
    result = dataclasses.replace(criticism(), remainder=Remainder("noise", {SIGNAL: 1.01}, ""))
    assert "The model misses dry friction and constant load at carriage." in check(to_html(result, title="drive.toml"))


def test_what_was_not_judged_by_itself_is_not_said_for_certain() -> None:
    """The search was stopped first; shares of the error are not known either."""
    result = criticism()
    rows = tuple(dataclasses.replace(c, score_gain=None) if c.accepted else c for c in result.candidates)
    stopped = dataclasses.replace(result, candidates=rows, steps=())
    assert words.headline(stopped).startswith("The model may miss dry friction")
    many = dataclasses.replace(stopped, accepted=tuple(f"dry_friction@j{k}" for k in range(5)))
    assert "and 2 more effects" in [text for _, text in first_screen(many)]


def test_a_bound_is_all_that_is_wrong_only_where_noise_is_left() -> None:
    key = "joint.carriage.damping"
    result = dataclasses.replace(
        criticism(), verdict="bounds_exclude_truth", widened={key: WidenedBounds((0.0, 0.2), (0.0, 2.0))}
    )
    clean = dataclasses.replace(result, remainder=Remainder("noise", {SIGNAL: 1.01}, ""))
    asked = f"the bounds of {key} exclude what the data ask for"
    assert words.headline(clean) == f"No effect is missing: {asked}."
    more = "or something that acts like them is missing; not all is explained, each ± may be too small."
    assert words.headline(result) == f"T{asked[1:]}, {more}"


@pytest.mark.parametrize(("p", "said"), [(0.97, "misses"), (0.7, "probably misses"), (0.3, "may miss")])
def test_the_headline_is_as_sure_as_the_least_probable_name(p: float, said: str) -> None:
    result = criticism()
    first, second = (c for c in result.candidates if c.accepted)
    known = {first.effect: 0.999, second.effect: p}
    candidates = tuple(dataclasses.replace(c, probability=known.get(c.effect)) for c in result.candidates)
    page = check(to_html(dataclasses.replace(result, candidates=candidates), title="drive.toml"))
    assert f"The model {said} dry friction and constant load at carriage" in page
    assert "above 0.99" in page
    assert f"{p:.2f}" in page


def test_the_first_screen_answers_the_four_questions() -> None:
    page = to_html(criticism(), title="drive.toml", refined=("refined.toml", "refined.xml"))
    text = check(page).partition("What to do next")[0]
    named = "The model misses dry friction and constant load at carriage"
    assert f"{named}, or what acts much like them; not all is explained, each ± may be too small." in text
    assert "Held-out error over 1 s: 6.6 mm → 2.0 mm (3.3 times better); noise explains 0.20 mm." in text
    for question in ("How wrong is the model?", "Where?", "What is missing?", "How much better now?"):
        assert question in text
    assert "where carriage is slower than 0.02 m/s" in text
    assert "22.0 ± 0.9 N" in text
    assert "60 % of the squared error" in text
    assert page.index("<svg") < page.index("What to do next")


def test_the_rest_is_there() -> None:
    text = check(to_html(criticism(), refined=("refined.toml", "refined.xml")))
    for part in (
        "Ranking of 6 candidate effects",
            "explains as much as constant load at carriage", "stiffness above 11 N/m",
        "delay above 1.2 ms", "only the ratio of mass and gear is known", "not determined alone", "from_xml_path",
        "|qvel.carriage| < 0.02 m/s", "by velocity of carriage", "How fast the error grows",
        "The worst windows of qpos.carriage", "Words used here", "is a special case of Stribeck friction",
        "the same as joint.carriage.damping", "Step by step", "fine enough",
    ):  # fmt: skip
        assert part in text, part


@pytest.mark.parametrize("verdict", list(words.VERDICTS))
@pytest.mark.parametrize("accepted", [True, False])
def test_every_verdict_gives_a_page(verdict: str | None, accepted: bool) -> None:
    result = dataclasses.replace(criticism(), verdict=verdict, what_to_record="at least 7 runs of 3 s")
    text = check(to_html(result if accepted else bare(result)))
    assert words.headline(result if accepted else bare(result)) in text
    assert "at least 7 runs of 3 s" in text


def test_adequate_claims_nothing() -> None:
    result = bare(criticism(), verdict="adequate", remainder=Remainder("noise", {SIGNAL: 1.01}, ""))
    text = check(to_html(result))
    assert "Nothing is missing" in text
    assert "times better" not in text
    assert "model after" not in text


def test_compare_says_how_wrong_and_names_nothing() -> None:
    result = bare(criticism(), verdict="unexplained", command="compare", candidates_tried=0)
    text = check(to_html(result))
    assert "The model misses qpos.carriage by 6.6 mm over 1 s, 33 times the noise floor." in text
    assert "Ranking" not in text


def test_a_search_that_was_stopped_does_not_claim_to_have_tried_all() -> None:
    text = check(to_html(bare(criticism(), verdict="unexplained", interrupted=True)))
    assert "the search was stopped before it could say why" in text
    assert "no effect that was tried" not in text


def test_a_search_that_had_no_time_to_try_anything_says_so() -> None:
    early = dataclasses.replace(bare(criticism(), verdict="unexplained"), candidates=(), candidates_tried=0)
    text = check(to_html(early))
    assert "the search ended before any effect was tried" in text
    assert "no effect that was tried" not in text


def test_a_tie_names_both() -> None:
    result = dataclasses.replace(
        criticism(), verdict="tie", accepted=("constant_load@carriage",), candidates=criticism().candidates[1:]
    )
    assert "the data cannot tell which: constant load or asymmetric friction at carriage." in check(to_html(result))


def test_what_moves_nothing_is_no_parameter() -> None:
    result = criticism()
    still = dataclasses.replace(result.candidates[-1], confounded_with=(MOVES_NOTHING,))
    text = check(to_html(dataclasses.replace(result, candidates=(*result.candidates[:-1], still))))
    assert "moves nothing that was measured" in text
    assert "Viscous friction at carriage would move nothing that was measured." in text
    assert MOVES_NOTHING not in text
    assert "free already" not in text


def test_of_many_values_a_tile_shows_the_first() -> None:
    result = criticism()
    of_runs = {f"frictionloss[run {k}]": next(iter(result.candidates[0].parameters.values())) for k in range(11)}
    first = dataclasses.replace(result.candidates[0], parameters=of_runs)
    assert "and 6 more values" in str(sizes([first]))
    assert str(sizes([first])).count("22.0 ± 0.9") == 5


def test_an_interval_has_the_digits_that_tell_its_ends_apart() -> None:
    assert phrases.interval(Estimate(0.148121, 1.5e-5, 0.148096, 0.148146, "m")) == "148.096 to 148.146 mm"
    assert phrases.interval(Estimate(22.0, 0.9, 20.5, 23.5, "N")) == "20.5 to 23.5 N"


def test_names_from_the_user_are_escaped() -> None:
    evil = "<script>alert(1)</script>"
    result = criticism()
    replays = tuple(dataclasses.replace(replay, run=evil) for replay in result.base.replays)
    base, final = (dataclasses.replace(model, replays=replays) for model in (result.base, result.final))
    text = to_html(dataclasses.replace(result, base=base, final=final, notes=(evil,)), title=evil)
    check(text)
    assert evil not in text


def test_several_signals_have_a_table() -> None:
    result, other = criticism(), "qvel.carriage"
    wide = {
        "measured": lambda r: torch.cat([r.measured, torch.full_like(r.measured, torch.nan)], 1),
        "simulated": lambda r: torch.cat([r.simulated, r.simulated], 1),
    }

    def widened(model: object) -> object:
        replays = [dataclasses.replace(r, **{k: f(r) for k, f in wide.items()}) for r in model.replays]  # type: ignore[attr-defined]
        return dataclasses.replace(model, replays=tuple(replays))  # type: ignore[type-var]

    errors = HeldOutError(
        *({SIGNAL: a, other: b} for a, b in ((0.00656, 0.2), (0.00199, 0.1), (0.0002, 1e-3), (1.0, 0.5)))
    )
    text = check(
        to_html(
            dataclasses.replace(
                result, signals=(SIGNAL, other), units={SIGNAL: "m", other: "m/s"}, heldout_error=errors,
                sensor_sd={SIGNAL: 1e-5, other: 1e-3}, base=widened(result.base), final=widened(result.final),
            )
        )
    )  # fmt: skip
    assert "Held-out error, signal by signal" in text
    assert "500 ms" in text
    # The signal that is furthest above its floor leads, even where it was hardly measured.
    assert "200 mm/s → 100 mm/s" in text


def test_no_replays_no_noise_no_failures() -> None:
    result = criticism()
    empty = tuple(dataclasses.replace(model, replays=()) for model in (result.base, result.final))
    errors = dataclasses.replace(result.heldout_error, noise_floor={SIGNAL: 0.0})
    text = check(
        to_html(
            dataclasses.replace(
                result, base=empty[0], final=empty[1], heldout_error=errors, failures=(), candidates=(), parameters={}
            )
        )
    )
    assert f"{SIGNAL}, RMS over 1 s of held-out data: no noise floor is known" in text
    assert "how much of it noise explains is not known" in text
    assert "noise explains 0" not in text
    assert "known (0" not in text


def test_a_long_log_stays_small() -> None:
    assert len(to_html(criticism(rate=500.0, seconds=12.0))) < 400_000


def test_a_change_between_runs_is_the_answer() -> None:
    page = to_html(changed(criticism()))
    assert "a change does: body.carriage.mass differs between the runs" in page
    assert "a parameter differs between runs" in page
    assert "Values of joint.carriage.damping would do as well." in page
    assert "scope = &quot;per_run&quot;" in page or 'scope = "per_run"' in page


def test_a_rival_stands_right_below_its_accepted_effect() -> None:
    result = criticism()
    rows = list(result.candidates)
    first = dataclasses.replace(rows[0], indistinguishable_from=("actuator_delay@motor",))
    late = dataclasses.replace(rows[4], score_gain=0.1, indistinguishable_from=(first.effect,))
    made = dataclasses.replace(result, candidates=(first, *rows[1:4], late, rows[5]))
    assert candidate_words.in_order(made)[1].effect == late.effect
    assert candidate_words.in_order(made)[1].score_gain is None  # beside the accepted one, which says nothing
    page = to_html(made)
    table = page[page.index("Ranking of 6 candidate effects") :]
    assert table.index("actuator delay at motor") < table.index("joint stiffness at carriage")
    assert "explains as much as dry friction at carriage" in table


def test_a_value_that_may_be_anywhere_within_its_bounds_is_not_determined() -> None:
    mass = Estimate(95.0, 33374.8, 50.0, 150.0, "kg", identifiable=False)
    small = Estimate(-5e-4, 6e-4, -1.6e-3, 6e-4, "rad")
    assert phrases.estimate(mass) == "not determined"
    assert phrases.estimate(small) == "-500 ± 600 µrad"  # determined: near zero
    result = criticism(rate=50.0, seconds=2.0)
    page = to_html(bare(result, parameters={**result.parameters, "body.carriage.mass": mass}))
    assert "not determined" in page
    assert "30000 kg" not in page


def test_a_value_is_known_of_a_model_that_leaves_no_more_than_noise() -> None:
    result = criticism(rate=50.0, seconds=2.0)
    clean = dataclasses.replace(result, remainder=Remainder("noise", {SIGNAL: 1.01}, ""))
    left, noise = to_html(result), to_html(clean)
    assert "in this model" in left
    assert "The model leaves more than noise: each ± may be too small." in left
    assert "in this model" not in noise
    assert "yes, to" in noise


def test_a_flat_direction_leaves_out_what_rounds_to_nothing() -> None:
    result = criticism(rate=50.0, seconds=2.0)
    one = FlatDirection("it moves nothing", {"body.carriage.mass": -1.0, "joint.carriage.damping": 5e-14})
    two = FlatDirection("only a ratio", {"body.carriage.mass": -0.8, "joint.carriage.damping": 0.6, "x": 0.004})
    page = to_html(bare(result, flat_directions=(one, two)))
    assert "<code>body.carriage.mass</code> alone" in page
    assert "-0.80 body.carriage.mass  +0.60 joint.carriage.damping<" in page


@pytest.mark.parametrize(("runs", "said"), [(7, "1 more run is in"), (8, "2 more runs are in")])
def test_runs_that_are_not_shown_are_counted(runs: int, said: str) -> None:
    result = criticism(rate=50.0, seconds=2.0)
    base, final = (
        dataclasses.replace(
            model, replays=tuple(dataclasses.replace(model.replays[0], run=f"n{k}") for k in range(runs))
        )
        for model in (result.base, result.final)
    )
    assert said in to_html(dataclasses.replace(result, base=base, final=final))
    assert phrases.more(1, "limit") == "1 more limit"
