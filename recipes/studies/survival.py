"""``make survival``: a run that is killed at random moments ends as if it had not been, to the last bit.

A recipe's short run is played once to its end, and then again and again in processes that are killed without warning
(SIGKILL) at random moments, while they save too, and begun anew until they end. The last checkpoints are compared:
networks, optimisers, buffers, worlds, belief, proposal, records, random numbers; all but the seconds that things took.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from onlinebayes.experiments import status
from onlinebayes.runs import Checkpoints, Progress, ResultTable
from recipes.studies.jobs import finished


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    recipe: str = "pendulum"
    """whose short run is killed"""
    kills: int = 20
    """in all"""
    seed: int = 0
    """of the moments"""
    out: str = "out/survival"
    """folder for the runs"""


def main(study: Study) -> int:
    """Run, kill, go on, compare; 0 when nothing differs."""
    table = ResultTable("survival", "make survival", [study.seed])
    whole = Path(study.out) / "whole"
    seconds = played(study.recipe, whole)
    expected = last(whole, study.recipe)
    moments, killed, ended, wrong = random.Random(study.seed), 0, 0, 0
    with Progress("survival", study.kills) as progress:
        while killed < study.kills:
            folder = Path(study.out) / f"killed-{ended}"
            shutil.rmtree(folder, ignore_errors=True)
            while killed < study.kills and not played_until(study.recipe, folder, moments.uniform(0.2, 1.0) * seconds):
                killed += 1
                progress.update(killed, f"{ended} runs ended, {wrong} of them differ")
            played(study.recipe, folder)
            ended += 1
            wrong += bool(differing(expected, last(folder, study.recipe)))
    table.add("kills at random moments", killed)
    table.add("runs that ended after them", ended)
    table.add("of these not the same to the last bit", wrong, goal="<= 0", holds=wrong == 0)
    return finished(table, Path("docs/results"))


def command(recipe: str, folder: Path) -> list[str]:
    """The recipe's short run."""
    return [sys.executable, "-m", f"recipes.{recipe}", "--short", "--out", str(folder)]


def played(recipe: str, folder: Path) -> float:
    """Play a run to its end; seconds."""
    start = time.monotonic()
    found = subprocess.run(command(recipe, folder), capture_output=True, text=True, check=False)
    if found.returncode:
        raise RuntimeError(f"the run ended with {found.returncode}: {found.stderr[-500:]}")
    return time.monotonic() - start


def played_until(recipe: str, folder: Path, seconds: float) -> bool:
    """Play a run and kill it after some time; whether it had ended before."""
    process = subprocess.Popen(
        command(recipe, folder), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return False
    return True


def last(folder: Path, recipe: str) -> dict[str, Any]:
    """State of a run's last checkpoint."""
    (run,) = [path.parent for path in folder.glob("*/run.json")]
    found = Checkpoints(run, recipe).load()
    if found is None:
        raise RuntimeError(f"{run} has no checkpoint")
    return found.state


def differing(first: Any, second: Any, path: str = "") -> list[str]:
    """Places at which two states are not the same to the last bit; seconds aside."""
    if "seconds" in path:
        return []
    if isinstance(first, torch.Tensor):
        same = isinstance(second, torch.Tensor) and first.dtype == second.dtype and first.shape == second.shape
        return [] if same and first.numpy().tobytes() == second.numpy().tobytes() else [path]
    if isinstance(first, dict):
        keys = {key for each in (first, second) for key in each if "seconds" not in str(key)}
        lost = [f"{path}/{key}" for key in keys if (key in first) != (key in second)]
        both = sorted((key for key in keys if key in first and key in second), key=str)
        return [*lost, *(place for key in both for place in differing(first[key], second[key], f"{path}/{key}"))]
    if isinstance(first, list | tuple):
        if len(first) != len(second):
            return [path]
        return [p for i, (a, b) in enumerate(zip(first, second, strict=True)) for p in differing(a, b, f"{path}/{i}")]
    return [] if first == second or (first != first and second != second) else [path]


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
