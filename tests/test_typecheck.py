"""What the tests check of shapes: first calls of each test, and some of those that follow."""

from __future__ import annotations

import jaxtyping
import pytest
import torch
from jaxtyping import Float, TypeCheckError, jaxtyped
from torch import Tensor

from tests import typecheck


@jaxtyped(typechecker=typecheck.check)
def inner(a: Float[Tensor, " n"], b: Float[Tensor, " n"]) -> Float[Tensor, ""]:
    return (a[:1] * b[:1]).sum()


def _fails(calls: int) -> int:
    """How many of so many wrong calls are noticed."""
    noticed = 0
    for _ in range(calls):
        try:
            inner(torch.ones(2), torch.ones(3))
        except TypeCheckError:
            noticed += 1
    return noticed


@pytest.mark.parametrize("again", [1, 2])
def test_the_first_calls_of_every_test_are_checked(again: int) -> None:
    assert _fails(typecheck.FIRST) == typecheck.FIRST
    assert 10 <= _fails(10 * typecheck.EVERY) < typecheck.EVERY  # arguments and results are counted apart
    inner(torch.ones(3), torch.ones(3))


def test_results_are_checked_too() -> None:
    @jaxtyped(typechecker=typecheck.check)
    def shorter(x: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        return x[1:]

    with pytest.raises(TypeCheckError):
        shorter(torch.ones(3))


def test_the_library_is_checked() -> None:
    assert not jaxtyping.config.jaxtyping_disable
    from onlinebayes.parameters import Parameter, ParameterSpace

    with pytest.raises(TypeCheckError):
        ParameterSpace({"m": Parameter(0.0, 1.0, "kg")}).contains("no tensor")  # type: ignore[arg-type]
