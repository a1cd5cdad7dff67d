"""A replay buffer of transitions: a ring of rows, dealt out at random with replacement.

TorchRL's ``ReplayBuffer`` spends half a millisecond on each sample of small rows, a third of a whole update, on
bookkeeping that a ring does not need. This one has its verbs (``extend``, ``sample``, ``len``, ``state_dict``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.runs import BadInput


class TransitionBuffer:
    """The last ``size`` transitions.

    Args:
        size: rows kept; the oldest are overwritten.
        device: where they lie.
    """

    def __init__(self, size: int, *, device: torch.device | str | None = None) -> None:
        if size < 1:
            raise ValueError(f"size = {size}: a buffer keeps one transition at least")
        self.size, self.device = size, torch.device(device) if device is not None else torch.device("cpu")
        self._rows: dict[Any, Tensor] = {}
        self._next, self._filled = 0, 0

    def __len__(self) -> int:
        """Rows that are there."""
        return self._filled

    def extend(self, data: TensorDictBase) -> None:
        """Remember rows, batch size (n,); of more than ``size`` the last ones."""
        data = data[-self.size :]
        places = (torch.arange(len(data), device=self.device) + self._next) % self.size
        for key in data.keys(True, True):
            value = data.get(key).detach()
            if key not in self._rows:
                self._rows[key] = value.new_zeros((self.size, *value.shape[1:]), device=self.device)
            self._rows[key].index_copy_(0, places, value.to(self.device))
        self._next = int(self._next + len(data)) % self.size
        self._filled = min(self.size, self._filled + len(data))

    def sample(self, number: int) -> TensorDict:
        """Rows at random, batch size (number,).

        Raises:
            ValueError: nothing was remembered yet.
        """
        return TensorDict(dict(self.draw(number)), batch_size=(number,), device=self.device)

    def draw(self, number: int) -> dict[Any, Tensor]:
        """The same as a plain dictionary, flat keys to tensors."""
        if not self._filled:
            raise ValueError("the buffer is empty; extend it first")
        index = torch.randint(self._filled, (number,), device=self.device)
        return {key: rows[index] for key, rows in self._rows.items()}

    def at(self, places: Tensor, keys: Iterable[Any] | None = None) -> dict[Any, Tensor]:
        """Read places (*batch) of the ring, of these keys or of all; the row after ``size - 1`` is row 0."""
        return {key: self._rows[key][places % self.size] for key in (self._rows if keys is None else keys)}

    def state_dict(self) -> dict[str, Any]:
        """The rows that are there, and where the next one goes."""
        rows = [[_text(key), rows[: self._filled].clone()] for key, rows in self._rows.items()]
        return {"size": self.size, "rows": rows, "next": self._next, "filled": self._filled}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Remember what :meth:`state_dict` gave.

        Raises:
            BadInput: it is of a buffer of another size.
        """
        if state["size"] != self.size:
            raise BadInput(f"the saved buffer has size {state['size']}", f"build it with that, not {self.size}")
        self._rows, self._next, self._filled = {}, state["next"], state["filled"]
        for name, rows in state["rows"]:
            whole = rows.new_zeros((self.size, *rows.shape[1:]), device=self.device)
            whole[: self._filled] = rows.to(self.device)
            self._rows[_key(name)] = whole


def _text(key: Any) -> str:
    return key if isinstance(key, str) else "\n".join(key)


def _key(text: str) -> Any:
    return tuple(text.split("\n")) if "\n" in text else text
