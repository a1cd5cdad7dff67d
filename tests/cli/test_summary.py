"""The terminal: a summary within 80 columns, and progress that rewrites one line or writes plain ones."""

from __future__ import annotations

import dataclasses
import io
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from onlinebayes.cli.summary import WIDTH, _wrapped, summary
from onlinebayes.criticism import Criticism
from onlinebayes.criticism.results import Step, Wiring
from onlinebayes.report import words
from onlinebayes.runs import Stages
from tests.report.many import many
from tests.report.synthetic import SIGNAL, changed, criticism, lagging, miswired


class Terminal(io.StringIO):
    """A stream that calls itself a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_line_answers_each_question() -> None:
    text = summary(criticism(rate=50.0, seconds=2.0), Path("out"))
    lines = {line[:10].strip(): line[11:] for line in text.splitlines() if line[:10].strip().endswith(":")}
    assert lines["verdict:"] == "missing_effect"
    assert lines["wrong:"] == f"{SIGNAL} by 6.6 mm over 1 s, 33 times the noise floor"
    assert lines["missing:"] == "dry_friction@carriage 22.0 ± 0.9 N: explains 53 %, gain 212 ± 31"
    assert lines["better:"] == "6.6 mm → 2.0 mm on held-out runs, 3.3 times better; noise 0.20 mm"
    assert lines["next:"] == "use refined.toml; onlinebayes next proposes a log that tests it"
    assert len(text.splitlines()) <= 12


def test_three_additions_are_named_and_the_others_are_told_together() -> None:
    result = criticism(rate=50.0, seconds=2.0)
    keys = [f"dry_friction@j{k}" for k in range(5)]
    errors = [{SIGNAL: error} for error in (9.0, 5.0, 4.0, 3.0, 2.9, 2.8)]
    steps = [Step(key, before, after, 1.0, 0.1, 6) for key, (before, after) in zip(keys, pairwise(errors), strict=True)]
    made = dataclasses.replace(result, accepted=tuple(keys), steps=tuple(steps))
    text = summary(made, Path("out"))
    assert "dry_friction@j0: explains 69 %" in text
    assert "dry_friction@j2: explains 9 %" in text
    assert "dry_friction@j3" not in text.partition("missing:")[2]
    assert "and 2 smaller imperfections: explain 1 %" in text


def test_a_number_stays_with_its_unit() -> None:
    lines = _wrapped("a" * 74 + " 0.18 m.")
    assert lines == ["a" * 74, "0.18 m."]


@pytest.mark.parametrize("command", ["compare", "diagnose", "refine"])
def test_it_fits_the_terminal(command: str) -> None:
    for result in (criticism(rate=50.0, seconds=2.0), many(joints=4, candidates=40)):
        made = dataclasses.replace(
            result, command=command, verdict="unexplained" if command == "compare" else result.verdict
        )
        lines = summary(made, Path("o"), ["refined.toml"]).splitlines()
        assert max(map(len, lines)) <= WIDTH, max(lines, key=len)
        assert len(lines) <= 16


def test_a_terminal_sees_one_line_and_keeps_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    with Stages() as say:
        say("fitting the base model")
        say("refitting 1 of 4: " + "a" * 100)
    shown = stream.getvalue().split("\r\x1b[K")
    assert "\n" not in stream.getvalue()
    assert shown[1] == "onlinebayes [0 s]: fitting the base mod"
    assert all(len(line) < 40 for line in shown)
    assert shown[-1] == ""


def test_an_answer_stays_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    with Stages() as say:
        say("fitting")
        say("so far: dry_friction@slide.")
        say("fitting")
    assert "onlinebayes [0 s]: so far: dry_friction@slide.\n" in stream.getvalue()
    assert stream.getvalue().count("\n") == 1


def test_a_log_keeps_every_line(capsys: pytest.CaptureFixture[str]) -> None:
    with Stages() as say:
        say("one")
        say("two")
    assert capsys.readouterr().err == "onlinebayes: one\nonlinebayes: two\n"


def test_a_change_between_runs_is_said_with_its_line() -> None:
    result = changed(criticism(rate=50.0, seconds=2.0))
    text = summary(result, Path("out"))
    assert "No effect explains the misfit, a change does: body.carriage.mass differs" in " ".join(text.split())
    assert "change:    body.carriage.mass differs between runs: plain 92" in text
    assert '    "body.carriage.mass" = { low = 50, high = 150, scope = "per_run" }' in text.splitlines()
    assert max(map(len, text.splitlines())) <= WIDTH


def test_what_refined_xml_lacks_is_one_line() -> None:
    text = summary(lagging(), Path("o"), ["refined.toml", "refined.xml"])
    assert (
        "refined.xml: without actuator_lag@motor, which plain MuJoCo has no term for;\n           refined.toml has it\n"
    ) in text
    assert "refined.xml" not in summary(lagging(), Path("o"))


def test_each_reason_is_said_once() -> None:
    term, short = "which has no term", "which is short"
    lacking = {"cogging@a": term, "actuator_delay@m": short, "actuator_lag@m": term}
    assert words.left_out(lacking, ["refined.toml", "refined.xml"], {}) == (
        f"refined.xml: without cogging@a and actuator_lag@m, {term}; without actuator_delay@m, {short}; "
        "refined.toml has them"
    )


def test_the_module_is_named_with_what_it_adds_and_what_it_lacks_too() -> None:
    term, log = "which plain MuJoCo has no term for", "which is of the log"
    lacking, files = {"cogging@a": term, "sensor_clock@s": term}, ["refined.xml", "refined_model.py"]
    assert words.left_out(lacking, files, {"sensor_clock@s": log}) == (
        f"refined.xml: without cogging@a and sensor_clock@s, {term}; "
        f"refined_model.py adds cogging@a (without sensor_clock@s, {log})"
    )


def test_too_little_data_implies_nothing_and_has_no_empty_table() -> None:
    result = criticism(rate=50.0, seconds=2.0)
    rows = tuple(dataclasses.replace(c, rank=None, score_gain=None, accepted=False) for c in result.candidates)
    made = dataclasses.replace(result, verdict="insufficient_data", accepted=(), candidates=rows)
    text = summary(made, Path("out"))
    assert "There is too little data to tell whether anything is missing." in text
    assert "candidate" not in text


def told(result: Criticism) -> str:
    return " ".join(summary(result, Path("out"), ["refined.toml", "refined.xml"]).split())


def test_a_fault_says_what_the_refined_files_hold() -> None:
    result = miswired()
    assert "refined.toml has the fault put right; its values and refined.xml are fitted to the mended table." in told(
        result
    )
    by_hand = dataclasses.replace(result, wiring=Wiring("motor was off in plain", "# in the table: a column", 9.0, 1.0))
    assert "refined.toml reads the table with the fault, which can only be put right there" in told(by_hand)
    assert "hold the model fitted to the table with the fault" in told(dataclasses.replace(result, corrected=None))
    assert "fault put right" not in " ".join(summary(result, Path("out")).split())


def test_compare_names_the_effects_that_were_added_by_hand() -> None:
    result = dataclasses.replace(criticism(rate=50.0, seconds=2.0), command="compare", verdict="unexplained")
    given = dataclasses.replace(result, final=dataclasses.replace(result.final, effects=("dry_friction@carriage",)))
    bare = dataclasses.replace(result, final=dataclasses.replace(result.final, effects=()))
    assert told(given).startswith("verdict: unexplained (with dry_friction@carriage added by hand)")
    assert told(bare).startswith("verdict: unexplained (no effect was tried)")
