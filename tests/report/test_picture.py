"""The PNG is a picture of both models, and is refused where there is nothing to draw."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from onlinebayes.report.picture import write_picture
from tests.report.synthetic import criticism


def colours(path: Path) -> set[tuple[int, ...]]:
    pixels = np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3)
    return {tuple(colour) for colour in np.unique(pixels, axis=0).tolist()}


def test_both_models_are_drawn(tmp_path: Path) -> None:
    write_picture(criticism(), tmp_path / "a.png")
    assert {(0xD1, 0x57, 0x1B), (0x17, 0x69, 0xAA)} <= colours(tmp_path / "a.png")


def test_one_model_is_drawn_once(tmp_path: Path) -> None:
    result = criticism()
    write_picture(dataclasses.replace(result, accepted=(), final=result.base), tmp_path / "a.png")
    assert (0xD1, 0x57, 0x1B) in colours(tmp_path / "a.png")
    assert (0x17, 0x69, 0xAA) not in colours(tmp_path / "a.png")


def test_nothing_to_draw_is_said(tmp_path: Path) -> None:
    result = criticism()
    base, final = (dataclasses.replace(model, replays=()) for model in (result.base, result.final))
    with pytest.raises(ValueError, match="no replayed run"):
        write_picture(dataclasses.replace(result, base=base, final=final), tmp_path / "a.png")
    assert not list(tmp_path.iterdir())
