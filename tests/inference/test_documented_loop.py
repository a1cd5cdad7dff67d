"""The loop of docs/concepts/posteriors.md, run as a reader would run it."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "concepts" / "posteriors.md"


def test_the_documented_loop_holds_the_truth_and_narrows_the_length(tmp_path: Path) -> None:
    """The page's seed is fixed; of 20 others none failed."""
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "loop.py").write_text(code, encoding="utf-8")
    names = runpy.run_path(str(tmp_path / "loop.py"))
    posterior, truth, space = names["posterior"], names["truth"], names["space"]
    prior = names["BoxUniform"](space)
    assert float(posterior.log_prob(truth)) > float(prior.log_prob(truth)) + 1.0
    assert abs(float(posterior.mean()[0] - truth[0, 0])) < 0.15
    assert names["proposal"].contains(truth).all()
