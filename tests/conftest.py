"""Shapes are checked while tests run, every test starts from the same seed, measured data is asked for by name."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest
from jaxtyping import install_import_hook

import tests.typecheck

install_import_hook(["onlinebayes", "envs"], "tests.typecheck.check")

# Tests run side by side already, and none may see what another one kept.
os.environ.setdefault("ONLINEBAYES_CORES", "1")
os.environ["ONLINEBAYES_CACHE"] = "off"

import torch  # noqa: E402

from onlinebayes.runs import Attempts, seed_everything  # noqa: E402

torch.set_num_threads(1)


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("gpu") is not None and not torch.cuda.is_available():
        pytest.skip("needs a CUDA device")


@pytest.fixture(autouse=True)
def _seed() -> None:
    seed_everything(0)
    tests.typecheck.begin_test()


@pytest.fixture
def faults_are_noted() -> None:
    """For tests of what is done about a fault of ours: it is noted, as users have it."""


@pytest.fixture(autouse=True)
def _faults_are_raised(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault of ours that work goes on without fails the test in which it happens."""
    if "faults_are_noted" not in request.fixturenames:
        monkeypatch.setattr(Attempts, "note", _raised)


def _raised(_attempts: Attempts, _what: str, error: Exception) -> None:
    raise error


@pytest.fixture
def without_shape_checks() -> Iterator[None]:
    """For long integrations, in which the checks would take most of the time."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture
def data() -> Path:
    """The folder of real measurements; skips where there is none, fails where CI promised one."""
    folder = os.environ.get("ONLINEBAYES_DATA")
    if folder and Path(folder).is_dir():
        return Path(folder)
    reason = "real data is absent: set ONLINEBAYES_DATA to the folder that holds emps/, ball_drops/, ..."
    if os.environ.get("ONLINEBAYES_REQUIRE_DATA"):
        pytest.fail(reason)
    pytest.skip(reason)
