"""``refine`` on drawn problems: it writes all of its files, or says in one line what is wrong with the input.

Twenty problems in ``make check``, always the same; ``make fuzz`` draws others, as many as ONLINEBAYES_FUZZ says.
"""

from __future__ import annotations

import io
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path

import jaxtyping
import mujoco
import pytest
from hypothesis import HealthCheck, given, settings

from onlinebayes.cli.main import main
from onlinebayes.criticism import refine
from onlinebayes.problems import commands, load_refined
from onlinebayes.runs import BadInput
from tests.cli.drawn_problems import Drawn, problems

CASES = int(os.environ.get("ONLINEBAYES_FUZZ", "0"))
FILES = {"report.json", "report.html", "run.rrd", "refined.toml", "refined.xml"}
BUDGET_S = 2.0
REFUSED = (
    "too few to compare anything",
    "a window of",
    "lasts",
    "and could with another unit",
)
"""What may be wrong with a drawn problem: its runs are short, or in degrees that make the replay diverge."""


@pytest.fixture(scope="module", autouse=True)
def _quick() -> Iterator[None]:
    """Searches that end soon, without shape checks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(commands, "refine", partial(refine, budget_s=BUDGET_S))
        jaxtyping.config.update("jaxtyping_disable", True)
        yield
        jaxtyping.config.update("jaxtyping_disable", False)


@pytest.mark.slow
@pytest.mark.timeout(0)
@settings(
    max_examples=CASES or 20,
    derandomize=not CASES,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)
@given(problems())
def test_refine_writes_its_files_or_says_what_is_wrong_with_the_input(drawn: Drawn) -> None:
    with tempfile.TemporaryDirectory() as place:
        file, out = drawn.write(Path(place)), Path(place) / "out"
        said, errors = io.StringIO(), io.StringIO()
        with redirect_stdout(said), redirect_stderr(errors):
            status = main(["refine", str(file), "--out", str(out)])
        last = errors.getvalue().splitlines()[-1]
        assert status in (0, 2), errors.getvalue()
        if status == 2:
            assert "Traceback" not in errors.getvalue()
            assert last.startswith("onlinebayes: error: ")
            assert any(rule in last for rule in REFUSED), last
            assert not out.exists()
            return
        report = json.loads((out / "report.json").read_text())
        assert report["failed"] == []
        refused = any("refined.xml was not written" in note for note in report["notes"])
        assert {path.name for path in out.iterdir()} >= FILES - ({"refined.xml"} if refused else set())
        if not refused:
            mujoco.MjModel.from_xml_path(str(out / "refined.xml"))
        refined = load_refined(out)
        assert refined.theta.isfinite().all()
        if report["wiring"]:
            # The values are fitted to a log with a fault in it: they are no belief about the machine.
            with pytest.raises(BadInput, match="its log has a fault"):
                _ = refined.belief
            return
        assert refined.belief.sample((2,)).shape[1] == len(refined.worlds(1).parameters)
