"""Equal values have one digest, others another one; somebody else's code has none."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter
from onlinebayes.runs import NoDigest, digest
from onlinebayes.simulators.effects import DryFriction
from tests.criticism.rigs import FREE, model

FRICTION = DryFriction("rail", Parameter(0.0, 2.0, "N"))


@dataclass(frozen=True)
class Ours:
    """A class of a module that may change at any time."""

    value: float = 1.0


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (1, 1.0),
        ("1", 1),
        (b"1", "1"),
        ([1, 2], (1, 2)),
        ([1, 2], [2, 1]),
        ([[1], [2]], [[1, 2]]),
        ({"a": 1}, {"a": 2}),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}),
        (torch.zeros(2, 3), torch.zeros(3, 2)),
        (torch.zeros(2), torch.zeros(2, dtype=torch.float64)),
        (torch.tensor([1.0]), torch.tensor([1.0 + 1e-7])),
        (Parameter(0.0, 1.0), Parameter(0.0, 2.0)),
        (Parameter(0.0, 1.0, "N"), Parameter(0.0, 1.0, "m")),
        (FRICTION, DryFriction("motor", Parameter(0.0, 2.0, "N"))),
    ],
)
def test_what_differs_has_another_digest(one: object, other: object) -> None:
    assert digest(one) != digest(other)
    assert digest(one) == digest(one)


def test_it_depends_on_values_alone() -> None:
    """Not on which objects are one and the same, nor on the order of a set."""
    name = "".join(["ra", "il"])
    assert digest(("rail", "rail")) == digest((name, "rail"))
    assert digest(np.float64(0.1)) == digest(0.1)
    assert digest({"a", "b", "c"}) == digest({"c", "b", "a"})
    rows = TensorDict({"x": torch.arange(3)}, batch_size=3)
    assert digest(rows) == digest(rows.clone())


def test_a_simulator_that_was_made_anew_has_the_same() -> None:
    assert digest(model()) == digest(model())
    others = [
        model().with_effect(FRICTION),
        model().with_timestep(0.005),
        model(FREE.replaced("body.cart.mass", Parameter(0.5, 9.0, "kg"))),
        model().with_runge_kutta(),
    ]
    # The slide is integrated by Runge's and Kutta's method already.
    assert [digest(one) == digest(model()) for one in others] == [False, False, False, True]


def test_it_is_the_same_in_another_process() -> None:
    """With another seed of the hashes of strings."""
    code = "from onlinebayes.runs import digest; print(digest({'a', 'b'}, [1.5, 'x'], {'k': (1, None)}))"
    seeded = {**os.environ, "PYTHONHASHSEED": "77"}
    said = subprocess.run([sys.executable, "-c", code], env=seeded, capture_output=True, text=True, check=True).stdout
    assert said.strip() == digest({"a", "b"}, [1.5, "x"], {"k": (1, None)})


@pytest.mark.parametrize("value", [Ours(), Ours, lambda: 1, [Ours()]])
def test_somebody_elses_code_has_none(value: object) -> None:
    with pytest.raises(NoDigest):
        digest(value)


def test_a_circle_has_none() -> None:
    around: list[object] = []
    around.append(around)
    with pytest.raises(NoDigest, match="hold each other"):
        digest(around)


def _bound(limits: Callable[[], object]) -> str:
    return digest(limits)


def test_a_method_speaks_of_its_object() -> None:
    one, other = Parameter(0.0, 1.0), Parameter(0.0, 2.0)
    assert _bound(one.__hash__) != _bound(other.__hash__)
