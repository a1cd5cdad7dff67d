"""Torch gets its threads back, however the block ends."""

import pytest
import torch

from onlinebayes.runs import one_torch_thread


def test_threads_are_one_inside_and_given_back() -> None:
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(3)
        with one_torch_thread():
            assert torch.get_num_threads() == 1
        with pytest.raises(ZeroDivisionError), one_torch_thread():
            _ = 1 / 0
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)


def test_it_decorates() -> None:
    @one_torch_thread()
    def inside() -> int:
        return torch.get_num_threads()

    assert (inside(), inside()) == (1, 1)
