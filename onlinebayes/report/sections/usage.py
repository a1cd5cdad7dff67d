"""Advice on the next step, on the use of the refined model, and an account of how the result was reached."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from onlinebayes.criticism import Criticism
from onlinebayes.identification import quantities
from onlinebayes.report import phrases, words
from onlinebayes.report.markup import Html, folded, join, section, table, tag
from onlinebayes.runs.results import machine, versions

NEXT = {
    "data_problem": "Put the lines below into the problem file, in place of keys that stand there already, and run "
    "again.",
    "insufficient_data": "Record more, then run again.",
    "bounds_exclude_truth": "Widen the bound named above if the value is physically possible, and run again.",
    "tie": "Decide by what you know of the machine, add that effect with --add, or record an experiment in which the "
    "tied effects act differently.",
    "missing_effect": "Use the refined model below. If what is left matters to you, look at where it concentrates.",
    "unexplained": "Look at where the error concentrates: the cause is outside the vocabulary, or two causes act at "
    "once. Free more parameters, add an effect of your own (effects.modules), or record simpler motions.",
    "adequate": "Use the model: these data cannot improve it.",
}

GLOSSARY = {
    "Effect": "a physical term that a simulator may have or lack, such as dry friction at a joint.",
    "Error": "the distance between what was measured and what the model simulates, as a root mean square.",
    "Window": "a short piece of a run. The model starts it from the measured state and then runs without correction.",
    "Held-out runs": "runs that had no part in fitting, nor in choosing what to add. What makes the error in them "
    "rise is taken out of the model again.",
    "Sensor noise": "what the sensors alone err by. What is left of a fitted model is compared with it.",
    "Noise floor": "the error that a perfect model would show in held-out runs: sensor noise, and windows that start a "
    "little off.",
    "90 % interval": "the range in which the data place a parameter with 90 % confidence; before the data, it could be "
    "anywhere within its bounds.",
    "Evidence": "how much better data that were left out of the fit are predicted with the effect than without "
    "(logarithm of the likelihood); twice its error is asked for.",
    "Block": "a stretch of data, or a run, that is left out in turn to see how well the rest predicts it.",
}

CHANGED = (
    "Find out what was changed between the runs. If it was meant, put the lines below into the problem file: every run "
    "then has a value of its own, as in the refined model."
)
RANK = "Run onlinebayes diagnose to rank the effects that could be missing."
ADD = "onlinebayes refine adds it, refits, and looks for more."


@dataclass(frozen=True)
class Files:
    """The refined model's files.

    Args:
        names: of those that stand beside the report.
        left_out: keys of the effects that refined.xml cannot hold -> why.
        lost: those that refined_model.py cannot hold either -> why.
    """

    names: tuple[str, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    lost: Mapping[str, str] = field(default_factory=dict)


def advice(result: Criticism, files: Files) -> Html:
    """The next step, and the refined model in use."""
    return join(_next(result), _snippet(result, files))


def _next(result: Criticism) -> Html:
    """Advise on the next step after this verdict."""
    record = tag("p", f"What to record: {result.what_to_record}") if result.what_to_record else ""
    advice = ADD if result.command == "diagnose" and result.accepted else NEXT[result.verdict]
    if result.only_compared:
        advice = RANK
    if result.changes and result.verdict == "unexplained":
        advice = CHANGED
    return join(tag("p", advice, kind="lead"), record, *_wiring(result), *_changes(result), *_notes(result))


def _changes(result: Criticism) -> list[Html]:
    """Show the parameters that differ between the runs, and the lines that give each run its own value."""
    sentences = words.changes(result)
    if not sentences:
        return []
    lines = "\n".join(change.lines for change in result.changes)
    return [*(tag("p", sentence) for sentence in sentences), tag("pre", tag("code", lines))]


def _wiring(result: Criticism) -> list[Html]:
    """The fault, the lines that mend it, and those that would do as well."""
    found = result.wiring
    if found is None:
        return []
    parts = [tag("p", words.wiring(result)), tag("pre", tag("code", found.lines))]
    for fault, lines in found.alternatives:
        parts += [tag("p", f"Or, if it is rather {fault}:"), tag("pre", tag("code", lines))]
    return parts


def _notes(result: Criticism) -> list[Html]:
    return [tag("p", note, kind="note") for note in result.notes]


def _snippet(result: Criticism, files: Files) -> Html:
    parts: list[str] = []
    if "refined.xml" in files.names:
        held = [effect for effect in result.final.effects if effect not in files.left_out]
        inside = f"  # {phrases.effects_in_words(held)} included" if held else ""
        code = f'import mujoco\n\nmodel = mujoco.MjModel.from_xml_path("refined.xml"){inside}\n'
        parts += [tag("p", "In plain MuJoCo, from the folder of this report:"), tag("pre", tag("code", code))]
    if "refined_model.py" in files.names:
        code = "from refined_model import RefinedModel\n\nmodel = RefinedModel()\nmodel.reset(qpos, qvel)\n"
        code += "signals = model.step(ctrl)\n"
        parts += [tag("p", "With what MuJoCo has no term for, there:"), tag("pre", tag("code", code))]
    left = words.left_out(files.left_out, files.names, files.lost)
    for sentence in (left, words.put_right(result) if files.names else ""):
        if sentence:
            parts.append(tag("p", sentence, kind="warning"))
    parts.append(_by_file(result, files))
    if "refined.toml" in files.names:
        command = "onlinebayes compare refined.toml --out again\n"
        parts += [
            tag("p", "On the command line there, against these or new measurements:"),
            tag("pre", tag("code", command)),
        ]
    return section("Use the refined model", *parts) if any(parts) else Html("")


def _by_file(result: Criticism, files: Files) -> Html:
    """The held-out error of refined.xml beside that of the whole model, where they are not the same."""
    if "refined_model.py" not in files.names or not result.file_error:
        return Html("")
    rows = [(tag("code", signal), *words.errors_of_files(result, signal)) for signal in words.signals_by_error(result)]
    head = ("signal", "refined.xml", "refined.toml" if files.lost else "refined_model.py")
    return table("Held-out error of refined.xml by itself and of the whole model", head, rows)


def _gone(result: Criticism) -> str:
    return phrases.listing([phrases.plain(effect) for effect in result.contradicted]) or "nothing"


def provenance(result: Criticism) -> Html:
    """Settings, checks and versions."""
    numerics, selection = result.numerics, result.selection
    blocks = result.candidates[0].n_blocks if result.candidates else selection.folds
    looks = {1: "once"}.get(result.holdout_looks, f"{result.holdout_looks} times")
    noise = [f"{name} {quantities.text(sd, result.units.get(name, ''))}" for name, sd in result.sensor_sd.items()]
    took = sum(timing.seconds for timing in result.timings)
    rows = [
        (
            "time step",
            f"{quantities.exact(numerics.timestep, 's')}, {_fineness(result)}",
        ),
        ("held-out runs", phrases.listing(list(result.held_out_runs)) or "none"),
        ("held-out runs opened", f"{looks}, for the reported error"),
        ("taken out, for that error rises with it", _gone(result)),
        ("windows", quantities.exact(selection.horizon_s, "s")),
        ("blocks of the cross-validation", str(blocks or "–")),
        ("sensor noise (sd)", phrases.listing(noise)),
        ("random numbers", "fixed seeds: the same data give the same result"),
        ("machine", machine()),
        ("time taken", quantities.text(took, "s") if took else "–"),
        ("versions", ", ".join(f"{name} {version}" for name, version in versions().items())),
    ]
    shown = table("Settings, checks and versions", ("what", "value"), rows)
    return join(section("Settings, checks and versions", shown), _stages(result), _glossary())


def _fineness(result: Criticism) -> str:
    if not result.numerics.sufficient:
        more = "no other effect" if result.accepted else "no effect"
        return f"too coarse to judge what is left by: a quarter of it moves the replay; {more} is named from these data"
    if result.remainder.status == "noise" and result.numerics.error_at_quarter_step > 1:  # floor
        return "the model's own, with which it follows the log better than with a finer one"
    return "fine enough: a quarter of it moves the replay by less than a tenth of what is left"


def _stages(result: Criticism) -> Html:
    """Show the stages of the work in order, and the time that each took."""
    if not result.timings:
        return Html("")
    rows = [(timing.stage, f"{timing.seconds:.1f} s") for timing in result.timings]
    shown = table("Stages of the work", ("stage", "time"), rows)
    return folded(f"{len(rows)} stages of the work and their times", shown)


def _glossary() -> Html:
    items = [join(tag("dt", name), tag("dd", meaning)) for name, meaning in GLOSSARY.items()]
    return section("Words used here", tag("dl", *items))
