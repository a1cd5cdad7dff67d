"""The pieces of docs/concepts/simulators.md in a loop of a reader's own, run as it stands."""

from __future__ import annotations

import math
import re
import runpy
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "concepts" / "simulators.md"


def test_collector_ppo_and_posterior_loss_compose_without_a_trainer_of_ours(tmp_path: Path) -> None:
    code, *more = (c for c in re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL) if "ppo(" in c)
    assert not more
    (tmp_path / "pieces.py").write_text(code, encoding="utf-8")
    names = runpy.run_path(str(tmp_path / "pieces.py"))
    batch, env, posterior, space = (names[name] for name in ("batch", "env", "posterior", "space"))
    assert batch.shape == (32, 64)
    assert all(math.isfinite(value) for value in names["losses"].values())
    assert names["loss"](names["simulated"])["loss_posterior"].item() < 0  # that of the prior, on the unit box
    drawn = env.reset()["theta"]
    assert env.transform.distribution is posterior
    assert space.contains(drawn).all()
    assert drawn.std(0).min() > 0
