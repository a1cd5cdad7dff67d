"""``make demo``: from a measurement to a better policy, end to end, in a few minutes and without a network."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from onlinebayes.experiments import closing_line, ended, status
from onlinebayes.runs import atomic_path
from recipes.demo.picture import picture
from recipes.demo.run import QUICK, SIGNAL, Branch, Budget, Outcome, run


@dataclass(frozen=True)
class Settings:
    """One demonstration."""

    out: Path = Path("out/demo")
    """folder for all files"""
    seed: int = 0
    """another rig, other noise, other networks"""
    short: bool = False
    """tiny budgets: shows that the pieces connect"""


def main(given: Settings) -> None:
    """Run the demonstration and print its table."""
    outcome = run(given.seed, given.out, QUICK if given.short else Budget())
    with atomic_path(given.out / "demo.png") as path:
        picture(outcome).savefig(path, dpi=150)
    print("\n" + table(outcome))
    print("\n" + directions(given.out))


def play(out: Path, seed: int, short: bool) -> int:
    """Do what ``onlinebayes demo`` does; returns the exit status."""
    return ended(lambda: main(Settings(out, seed, short)))


def table(outcome: Outcome) -> str:
    """Held-out error before and after, and the two returns."""
    error, (difference, se) = outcome.criticism.heldout_error, outcome.advantage
    before, after, floor = (1e3 * e[SIGNAL] for e in (error.before, error.after, error.noise_floor))
    effects = ", ".join(outcome.criticism.accepted) or "nothing"
    rows = [
        ("", "model as it was", "mended model"),
        ("missing effect, as named by diagnose", "", effects),
        (
            f"held-out error over {error.horizon_s[SIGNAL]:g} s (noise: {floor:.1f} mrad)",
            f"{before:.1f} mrad",
            f"{after:.1f} mrad",
        ),
        (f"return on the rig, {len(outcome.mended.returns)} episodes", _return(outcome.wrong), _return(outcome.mended)),
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(3)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    lines.insert(1, "-" * len(max(lines, key=len)))
    verdict = f"{abs(difference) / se:.0f} standard errors" if se > 0 else "no spread"
    told = f"{abs(difference):.1f} steps {'longer' if difference > 0 else 'shorter'}"
    lines.append(f"the mended model's policy holds the bob {told} ({verdict})")
    lines.append(f"took {outcome.seconds:.0f} s")
    return "\n".join(lines)


def directions(out: Path) -> str:
    """List the files that were written and the commands that open them."""
    refine = out / "refine"
    return "\n".join(
        [
            f"criticism: {refine / 'report.html'} and {refine / 'run.rrd'}   open both with: onlinebayes show {refine}",
            f"picture:   {out / 'demo.png'}",
            closing_line(out),
        ]
    )


def _return(branch: Branch) -> str:
    se = float(branch.returns.std() / len(branch.returns) ** 0.5)
    return f"{float(branch.returns.mean()):.1f} ± {se:.1f}"


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
