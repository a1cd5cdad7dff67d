"""What is global to the process is after a use of TorchRL's collectors and environments what it was before."""

from __future__ import annotations

import ast
import gc
import multiprocessing
import os
import random
import re
import warnings
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import torchrl
from torchrl.envs.utils import exploration_type

import onlinebayes
from onlinebayes.objectives.testing import check_objective
from onlinebayes.simulators.testing import check_parameterized
from onlinebayes.trainers import OnlineState, collector_of
from onlinebayes.trainers.distributed import Here, PartedCollector, PartedSimulations, in_parts
from onlinebayes.transforms import ParameterRandomization
from onlinebayes.transforms.testing import check_batched, check_parallel, check_serial, check_transform
from tests.control import test_mppi
from tests.objectives.test_conformance import BUILT
from tests.simulators import test_parameterized
from tests.trainers.test_env_problem import PROBLEM, TRUTH, policy, trainer
from tests.transforms.test_embedding import _transform, make_env


@cache
def acting() -> Any:
    return policy()


def collected() -> None:
    collector_of(PROBLEM.worlds(2, ParameterRandomization(PROBLEM.prior), 0), acting(), 4).next()


def collected_in_parts() -> None:
    drawn = ParameterRandomization(PROBLEM.prior)
    PartedCollector(in_parts(PROBLEM.worlds, 4, 2, 0), acting(), 4, drawn, Here(2), 0).next()


def simulated_in_parts() -> None:
    PartedSimulations(PROBLEM.worlds, 4, 5, Here(2), 0).draw([acting()], PROBLEM.prior)


def closed() -> None:
    PROBLEM.worlds(3, ParameterRandomization(PROBLEM.prior), 0).close()


def an_objective() -> None:
    make_env, make = BUILT["ppo"]
    check_objective(make, make_env)


DRAWS = "draws"
"""Places whose policies act, or whose theta is drawn, by the global random numbers."""
PLACES: dict[str, tuple[Callable[[], object], str]] = {
    "a judge": (lambda: PROBLEM.score(acting(), TRUTH), ""),
    "simulations": (lambda: PROBLEM.simulations(8, 5, seed=0).draw([acting()], PROBLEM.prior), DRAWS),
    "a hidden system": (lambda: PROBLEM.hidden(TRUTH, 0).run(acting(), 5), DRAWS),
    "specs": (lambda: PROBLEM.specs, ""),
    "worlds that are closed": (closed, ""),
    "a collector": (collected, DRAWS),
    "a collector in parts": (collected_in_parts, ""),
    "simulations in parts": (simulated_in_parts, DRAWS),
    "a run": (lambda: trainer("policy-only").run(OnlineState.begin(PROBLEM.prior)), DRAWS),
    "check_objective": (an_objective, ""),
    "check_planner": (test_mppi.test_conformance, ""),
    "check_transform": (lambda: check_transform(make_env, _transform), ""),
    "check_serial": (lambda: check_serial(make_env, _transform), ""),
    "check_batched": (lambda: check_batched(make_env, _transform), ""),
    "check_parallel": (lambda: check_parallel(make_env, _transform), ""),
    "check_parameterized": (
        lambda: check_parameterized(partial(test_parameterized.pendulum, 50), test_parameterized.SPACE),
        "",
    ),
}
SLOW = ("check_parallel",)
BUILT_BY = re.compile(r"(Serial|Parallel)Env|\w*Collector|_Beside")


@pytest.fixture
def _few_threads_of_many(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """TorchRL believes that torch had eight threads when it was imported."""
    monkeypatch.setattr(torchrl, "_THREAD_POOL_INIT", 8)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


def state() -> dict[str, Any]:
    gc.collect()  # forgotten environments are closed
    return {
        "threads": torch.get_num_threads(),
        "exploration": exploration_type(),
        "gradients": torch.is_grad_enabled(),
        "type": torch.get_default_dtype(),
        "warnings": list(warnings.filters),
        "environment": dict(os.environ),
        "start of processes": multiprocessing.get_start_method(allow_none=True),
        "sharing": torch.multiprocessing.get_sharing_strategy(),
        "Python's random numbers": random.getstate(),
        "NumPy's random numbers": np.random.get_state()[1].tolist(),
        "torch's random numbers": torch.get_rng_state().tolist(),
    }


@pytest.mark.slow
@pytest.mark.usefixtures("_few_threads_of_many", "without_shape_checks")
@pytest.mark.parametrize("place", [pytest.param(p, marks=[pytest.mark.slow] * (p in SLOW)) for p in PLACES])
def test_all_is_as_it_was(place: str) -> None:
    use, draws = PLACES[place]
    acting()  # whose weights are drawn at random
    before = state()
    use()
    after = state()
    changed = [key for key in before if before[key] != after[key]]
    assert [key for key in changed if not (draws and key == "torch's random numbers")] == []


def test_these_are_all_places() -> None:
    """A file of the library that builds such an environment or collector, and is not known here, needs its place."""
    root, places = Path(onlinebayes.__file__).parent, set()
    for path in root.rglob("*.py"):
        calls = [node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
        if any(isinstance(name, ast.Name) and BUILT_BY.fullmatch(name.id) for name in calls):
            places.add(str(path.relative_to(root)))
    assert places == {
        "control/testing.py",
        "objectives/testing.py",
        "simulators/testing/parameterized.py",
        "trainers/collecting.py",
        "trainers/env_problem.py",
        "trainers/problem.py",
        "transforms/testing.py",
    }
