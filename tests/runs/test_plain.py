"""Values for a checkpoint: plain ones, read back as they were without any code."""

from __future__ import annotations

import enum
import io
from collections import OrderedDict, namedtuple
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import MemoryMappedTensor, TensorDict

from onlinebayes.runs import plain
from onlinebayes.runs.plain import compact


def through_torch(value: object) -> object:
    file = io.BytesIO()
    torch.save(value, file)
    file.seek(0)
    return torch.load(file, weights_only=True)


def same(first: object, second: object) -> bool:
    if isinstance(first, torch.Tensor):
        return torch.equal(first, second) and first.dtype == second.dtype
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    if isinstance(first, list | tuple):
        return type(first) is type(second) and len(first) == len(second) and all(map(same, first, second))
    return type(first) is type(second) and (first == second or repr(first) == repr(second) == "nan")


class Colour(enum.IntEnum):
    RED = 3


class Name(str, enum.Enum):  # noqa: UP042
    ONE = "one"


Pair = namedtuple("Pair", "a b")
VALUES = [
    (None, None),
    (True, True),
    (2**70, 2**70),
    (-(2**40), -(2**40)),
    (float("nan"), float("nan")),
    (float("-inf"), float("-inf")),
    (1 + 2j, 1 + 2j),
    (b"\x00\xff", b"\x00\xff"),
    ("naïve\n", "naïve\n"),
    (Colour.RED, 3),
    (Name.ONE, "one"),
    ({Name.ONE: {("a", "b"): 1}, 3: 2}, {"one": {("a", "b"): 1}, 3: 2}),
    (Pair(1, 2.5), (1, 2.5)),
    (OrderedDict(a=[1, (2,)]), {"a": [1, (2,)]}),
    (np.float32(1.5), 1.5),
    (np.bool_(True), True),
    (np.arange(6, dtype=np.uint16)[::-2], torch.tensor([5, 3, 1], dtype=torch.uint16)),
    (np.array(2.0), torch.tensor(2.0, dtype=torch.float64)),
    (torch.zeros(0, 3), torch.zeros(0, 3)),
    (torch.tensor([1.5], dtype=torch.bfloat16), torch.tensor([1.5], dtype=torch.bfloat16)),
    (torch.nn.Parameter(torch.ones(2)), torch.ones(2)),
    (TensorDict({"a": {"b": torch.ones(2, 1)}}, (2,)), {"a": {"b": torch.ones(2, 1)}}),
    (MemoryMappedTensor.from_tensor(torch.ones(3)), torch.ones(3)),
]


@pytest.mark.parametrize("function", [plain, compact])
@pytest.mark.parametrize(("value", "expected"), VALUES, ids=lambda x: str(type(x).__name__))
def test_a_value_comes_back_plain(function, value: object, expected: object) -> None:
    assert same(through_torch(function(value)), expected)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (object(), "state is a object"),
        ({"a": [torch.nn.Linear(1, 1)]}, r"state\.a\[0\] is a Linear"),
        ({"f": {3: len}}, r"state\.f\.3 is a builtin"),
        ({1.5: 2}, "a key of state is a float"),
        ({("a", 2.5): 2}, "a key of state is a float"),
        ({"path": Path("x")}, r"state\.path is a PosixPath"),
        ({"x": np.array(["text"])}, r"state\.x is a NumPy array of <U4"),
        ({"x": np.array([None])}, r"state\.x is a NumPy array of object"),
        ({"d": torch.float32}, r"state\.d is a dtype"),
        ({"g": torch.Generator()}, r"state\.g is a Generator"),
    ],
)
def test_what_is_no_plain_value_is_refused_by_its_place(value: object, told: str) -> None:
    with pytest.raises(TypeError, match=told):
        plain(value)


def test_plain_values_are_copies_and_compact_ones_are_not() -> None:
    tensor = torch.zeros(3)
    assert plain({"x": tensor})["x"].data_ptr() != tensor.data_ptr()
    assert compact({"x": tensor})["x"].data_ptr() == tensor.data_ptr()


def test_a_part_of_a_large_tensor_is_saved_as_a_part() -> None:
    large = torch.zeros(100_000)
    file = io.BytesIO()
    torch.save(compact({"x": large[:10]}), file)
    assert file.tell() < 10_000


def test_tensors_that_share_memory_come_back_apart() -> None:
    tensor = torch.zeros(3)
    state = through_torch(compact({"a": tensor, "b": tensor, "c": [tensor.view(3, 1)]}))
    state["a"] += 1
    assert state["b"].tolist() == [0, 0, 0]
    assert state["c"][0].tolist() == [[0], [0], [0]]
