"""Which runs a draft holds out: a third, and at least one of each kind of motion stays to fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from onlinebayes.measurements import Measurement
from onlinebayes.problems.drafting.holding_out import held_out


def moved(motions: Mapping[str, tuple[float, float]], seed: int = 0) -> Measurement:
    """Sines of an amplitude and a frequency, with noise, under the names of runs."""
    time, noise = np.arange(0, 10, 0.02), np.random.default_rng(seed)
    runs = {
        name: {
            "time": time,
            "ctrl.motor": size * np.sin(rate * time),
            "qpos.joint": 0.1 * size * np.sin(rate * time - 1) + 1e-4 * noise.normal(size=len(time)),
        }
        for name, (size, rate) in motions.items()
    }
    return Measurement.from_runs(runs)


@pytest.mark.parametrize(("runs", "held"), [(1, 0), (2, 1), (7, 2), (8, 1), (9, 2), (10, 3), (30, 10)])
def test_the_last_third_of_runs_alike_is_held_out(runs: int, held: int) -> None:
    """Seven runs are blocks of their own, however slow the misfit."""
    names = [f"run{r}" for r in range(runs)]
    last = names[runs - held :]
    assert held_out(names) == last
    assert held_out(names, moved({name: (1 + 0.02 * r, 3.0) for r, name in enumerate(names)})) == last


@pytest.mark.parametrize(
    "names",
    [
        [f"{kind}_{k}" for kind in ("sine", "chirp", "steps") for k in range(1, 4)],
        [f"{kind}_{k}" for k in range(1, 4) for kind in ("sine", "chirp", "steps")],
        [f"2026-05-01 sine{k}" for k in range(6)] + ["2026-05-01 fall", "2026-05-02 fall", "2026-05-03 fall"],
    ],
)
def test_names_tell_kinds_of_motion(names: Sequence[str]) -> None:
    held = held_out(names)
    assert held
    assert {name.strip("-_0123456789") for name in names if name not in held} == {
        name.strip("-_0123456789") for name in names
    }


@pytest.mark.parametrize("faster", [1.0, 8.0])
def test_commands_tell_kinds_of_motion(faster: float) -> None:
    """The last three of ten runs are the only ones of their kind: two of them stay."""
    larger = 1.0 if faster > 1 else 5.0
    motions = {f"run{r}": (larger, 3 * faster) if r > 6 else (1.0, 3.0) for r in range(10)}
    assert held_out([*motions], moved(motions)) == ["run5", "run6", "run9"]


def test_of_runs_that_all_differ_one_amid_the_others_is_held_out() -> None:
    sizes = {"soft": 1.0, "hard": 30.0, "middle": 6.0}
    assert held_out([*sizes], moved({name: (size, 3.0) for name, size in sizes.items()})) == ["middle"]
    loudest_last = {"a1": 1.0, "a2": 3.0, "a3": 9.0, "a4": 27.0}
    assert held_out([*loudest_last], moved({name: (size, 3.0) for name, size in loudest_last.items()})) == ["a3"]


def test_what_rests_in_every_run_tells_no_kinds() -> None:
    time = np.arange(0, 4, 0.02)
    runs = {f"run{r}": {"time": time, "ctrl.motor": 0 * time, "qpos.joint": 0 * time + r} for r in range(6)}
    assert held_out([*runs], Measurement.from_runs(runs)) == ["run4", "run5"]
