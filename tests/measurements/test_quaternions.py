"""Orientations become unit quaternions without jumps of sign, and what is no orientation is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from onlinebayes.measurements import Measurement, Signal, TableReader
from onlinebayes.measurements.quaternions import quaternions
from onlinebayes.runs import BadInput

FREE = [f"qpos.body.{k}" for k in range(7)]
TURN = np.linspace(0, 12, 40)
TRUTH = np.stack([np.cos(TURN / 2), np.zeros(40), np.zeros(40), np.sin(TURN / 2)], -1)


def read(tmp_path: Path, orientation: np.ndarray, names: list[str] = FREE) -> Measurement:
    rows = [",".join(["time", *names])]
    for k, q in enumerate(orientation):
        cells = [0.1, 0.2, 0.3, *q][: len(names)]
        rows.append(",".join([f"{k}", *("" if np.isnan(cell) else repr(float(cell)) for cell in cells)]))
    (tmp_path / "log.csv").write_text("\n".join(rows))
    return TableReader([Signal(name) for name in FREE], []).read([tmp_path / "log.csv"])


def test_which_signals_are_quaternions():
    ball = [f"qpos.ball.{k}" for k in range(4)]
    assert quaternions(["qpos.hinge", *FREE, "qvel.body.0"]) == (tuple(FREE[3:]),)
    assert quaternions([*ball, *(f"qvel.ball.{k}" for k in range(3))]) == (tuple(ball),)
    assert quaternions(["qpos.x.0", "qpos.x.1", "qpos.x.2"]) == ()
    for count in (4, 7):  # hinges called leg.0, leg.1, ...
        assert quaternions([f"{kind}.leg.{k}" for kind in ("qpos", "qvel") for k in range(count)]) == ()


def test_signs_and_norms_are_mended(tmp_path):
    draw = np.random.default_rng(0)
    flipped = TRUTH * draw.choice([-1.0, 1.0], size=(40, 1)) * draw.uniform(0.95, 1.05, size=(40, 1))
    flipped *= np.sign(flipped[0, 0])
    flipped[7] = np.nan
    found = read(tmp_path, flipped).data
    seen = found["measured"][0, :, 3].numpy()
    assert seen.tolist() == [k != 7 for k in range(40)]
    assert np.allclose(found["signal"][0, seen, 3:].numpy(), TRUTH[seen], atol=1e-12)
    assert np.allclose(found["signal"][0, :, :3].numpy(), [0.1, 0.2, 0.3])


def test_what_is_no_orientation(tmp_path):
    half = TRUTH.copy()
    half[3, 1] = np.nan
    with pytest.raises(BadInput, match=r"row 5, column 'qpos\.body\.3': only some parts of a quaternion"):
        read(tmp_path, half)
    with pytest.raises(BadInput, match=r"row 2, column 'qpos\.body\.3': a quaternion of norm 2"):
        read(tmp_path, 2 * TRUTH)
    with pytest.raises(BadInput, match="norm 0"):
        read(tmp_path, 0 * TRUTH)
    with pytest.raises(BadInput, match=r"no column 'qpos\.body\.6'; a quaternion has all four parts"):
        read(tmp_path, TRUTH, FREE[:6])
