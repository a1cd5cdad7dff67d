"""What a command found, in a few lines for the terminal."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.criticism import Criticism

VERDICTS = {
    "data_problem": "the measurements do not fit the problem file",
    "insufficient_data": "the measurements are too few to decide",
    "bounds_exclude_truth": "the bounds of a parameter exclude what the measurements say",
    "tie": "several effects explain the measurements equally",
    "missing_effect": "the model lacked a physical effect",
    "unexplained": "the model fails, and no effect that was tried explains it",
    "adequate": "the model is as good as the measurements can tell",
}


def summary(result: Criticism, folder: Path) -> str:
    """Verdict, accepted effects, held-out error before and after, and where the report lies."""
    lines = []
    if result.verdict is not None:
        lines.append(f"verdict:    {result.verdict}: {VERDICTS[result.verdict]}")
    if result.what_to_record:
        lines.append(f"to record:  {result.what_to_record}")
    if result.command == "diagnose":
        lines += _ranking(result)
    if result.accepted:
        lines.append(f"added:      {', '.join(result.accepted)}")
    lines += _errors(result)
    if result.remainder.where:
        lines.append(f"remainder:  {result.remainder.status}; {result.remainder.where}")
    lines += [f"note:       {note}" for note in result.notes]
    lines.append(f"report:     {folder / 'report.html'}   (onlinebayes show {folder})")
    return "\n".join(lines)


def _ranking(result: Criticism, most: int = 3) -> list[str]:
    lines: list[str] = []
    ranked = sorted((c for c in result.candidates if c.rank is not None), key=lambda c: c.rank or 0)
    for candidate in ranked[:most]:
        p = "" if candidate.p_value is None else f"  p = {candidate.p_value:.3g}"
        gain = "" if candidate.score_gain is None else f"  score gain {candidate.score_gain:.3g}"
        se = "" if candidate.score_gain_se is None else f" +- {candidate.score_gain_se:.2g}"
        lines.append(f"{'missing:' if not lines else '':<12}{candidate.rank}. {candidate.effect}{p}{gain}{se}")
    return lines


def _errors(result: Criticism) -> list[str]:
    held = result.heldout_error
    lines: list[str] = []
    for name, before in held.before.items():
        unit = result.units.get(name, "")
        after, floor = held.after.get(name), held.noise_floor.get(name)
        change = f"{before:.3g} {unit}"
        if result.accepted and after is not None:
            change = f"{before:.3g} -> {after:.3g} {unit}"
        noise = "" if floor is None else f", noise floor {floor:.2g} {unit}"
        horizon = f" over {held.horizon_s[name]:g} s" if name in held.horizon_s else ""
        lines.append(f"{'held out:' if not lines else '':<12}{name} error {change}{noise}{horizon}")
    return lines
