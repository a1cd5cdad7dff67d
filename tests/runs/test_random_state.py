"""Random numbers go on to the last bit where they stood."""

from __future__ import annotations

import io
import random

import numpy as np
import pytest
import torch

from onlinebayes.runs import Checkpoints, random_state, set_random_state


def draws() -> list[object]:
    """Of odd number, so that a normal value is left over in each generator that makes them in pairs."""
    return [
        random.random(),
        random.gauss(0, 1),
        random.randrange(2**80),
        np.random.rand(3).tolist(),
        np.random.standard_normal(),
        torch.rand(7).tolist(),
        torch.randn(5, dtype=torch.float64).tolist(),
        torch.randn(1).tolist(),
        torch.randperm(10).tolist(),
    ]


@pytest.mark.usefixtures("without_shape_checks")  # which draw from Python's random numbers
@pytest.mark.parametrize("before", [0, 1, 3])
def test_random_numbers_go_on_where_they_stood(before: int, tmp_path) -> None:
    for _ in range(before):
        draws()
    Checkpoints(tmp_path, "recipe").save(random_state())
    first = [draws() for _ in range(3)]
    set_random_state(Checkpoints(tmp_path, "recipe").load().state)
    assert [draws() for _ in range(3)] == first


def test_a_state_is_read_without_code() -> None:
    file = io.BytesIO()
    torch.save(random_state(), file)
    file.seek(0)
    set_random_state(torch.load(file, weights_only=True))


def test_a_generator_of_its_own_goes_on_too() -> None:
    generator = torch.Generator().manual_seed(3)
    torch.randn(3, generator=generator)
    state = generator.get_state()
    first = torch.randn(5, generator=generator)
    other = torch.Generator()
    other.set_state(state)
    assert torch.equal(torch.randn(5, generator=other), first)
