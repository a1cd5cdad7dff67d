"""Parts are brought back to where they stood, and what does not fit is named in one line."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from onlinebayes.runs import BadInput, Stateful, gather, plain, restore, restore_part


def network(width: int = 4) -> nn.Sequential:
    return nn.Sequential(nn.Linear(3, width), nn.Tanh(), nn.Linear(width, 1))


def test_parts_come_back() -> None:
    parts = {"policy": network(), "critic": network(5)}
    assert all(isinstance(part, Stateful) for part in parts.values())
    state = plain(gather(parts))
    fresh = {"policy": network(), "critic": network(5)}
    restore(fresh, state)
    x = torch.rand(2, 3)
    assert all(torch.equal(fresh[name](x), parts[name](x)) for name in parts)


def test_a_missing_or_unknown_part_is_named() -> None:
    state = gather({"policy": network()})
    with pytest.raises(BadInput, match="lacks critic; this run has policy, critic"):
        restore({"policy": network(), "critic": network()}, state)
    with pytest.raises(BadInput, match="the saved state holds policy too"):
        restore({}, state)
    with pytest.raises(BadInput, match="lacks actor and holds policy too"):
        restore({"actor": network()}, state)


def test_other_widths_are_told_by_the_first_tensor_that_differs() -> None:
    with pytest.raises(
        BadInput, match=r"policy\.0\.weight was saved with shape \(4, 3\), this run's has \(8, 3\)"
    ) as e:
        restore_part("policy", network(8), network(4).state_dict())
    assert "\n" not in str(e.value)
    assert "settings that began the run" in str(e.value)


def test_other_layers_are_told_by_their_name() -> None:
    with pytest.raises(BadInput, match=r"only this run has policy\.3\.weight"):
        restore_part("policy", nn.Sequential(*network(), nn.Linear(1, 1)), network().state_dict())
    with pytest.raises(BadInput, match=r"only the saved state has policy\.2\.weight"):
        restore_part("policy", network()[:2], network().state_dict())


class Part:
    """Says what it is told to say when it is loaded."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def state_dict(self) -> dict[str, object]:
        return {}

    def load_state_dict(self, state: object) -> None:
        raise self.error


def test_a_parts_own_words_are_kept_in_one_line() -> None:
    with pytest.raises(BadInput, match=r"^too many rows$"):
        restore_part("buffer", Part(BadInput("too many rows")), {})
    with pytest.raises(BadInput, match="the saved buffer does not fit this run: a b"):
        restore_part("buffer", Part(ValueError("a\nb")), {"rows": 1})
