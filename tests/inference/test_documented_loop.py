"""The loop of docs/concepts/posteriors.md, run as a reader would run it."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "concepts" / "posteriors.md"


def test_the_documented_loop_holds_the_truth_and_narrows_the_length(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page's seed is fixed; of 12 others none puts the truth below 3.4 nats, where this asks for 0.2."""
    monkeypatch.chdir(tmp_path)
    example = PAGE.read_text(encoding="utf-8").partition("## An example")[2]
    blocks = re.findall(r"```python\n(.*?)```", example, re.DOTALL)
    (tmp_path / "loop.py").write_text("\n".join(blocks), encoding="utf-8")
    names = runpy.run_path(str(tmp_path / "loop.py"))
    posterior, truth, space = names["posterior"], names["truth"], names["space"]
    prior = names["BoxUniform"](space)
    assert float(posterior.log_prob(truth)) > float(prior.log_prob(truth)) + 1.0
    assert abs(float(posterior.mean()[0] - truth[0, 0])) < 0.15
    assert "length and mass are known; left of the prior's width: length (" in capsys.readouterr().out
    assert names["proposal"].contains(truth).all()
    assert names["known"].log_prob(truth) == posterior.log_prob(truth), "the file holds the same"
    lengths = (x[:, 0].double() for x in (names["theta"], posterior.sample((1000,)), prior.sample((1000,))))
    spread = [float(x.quantile(0.75) - x.quantile(0.25)) for x in lengths]
    # Sixteen worlds: a standard error of three tenths.
    assert spread[1] / 3 < spread[0] < 2 * spread[1] < spread[2], "worlds are drawn from it"
