"""Parts that can say where they stand, gathered into one state and brought back; what does not fit is named.

state = gather({"objective": objective, "belief": belief})
restore({"objective": objective, "belief": belief}, state)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from torch import Tensor

from onlinebayes.runs.errors import BadInput
from onlinebayes.runs.printable import one_line

CURE = "go on with the settings that began the run, or choose another folder"


@runtime_checkable
class Stateful(Protocol):
    """A part that can say where it stands."""

    def state_dict(self) -> dict[str, Any]:
        """Plain values."""
        ...

    def load_state_dict(self, state: Any, /) -> Any:
        """Stand there again."""
        ...


def gather(parts: Mapping[str, Stateful]) -> dict[str, Any]:
    """Return the state of each part, by its name."""
    return {name: part.state_dict() for name, part in parts.items()}


def restore(parts: Mapping[str, Stateful], state: Mapping[str, Any]) -> None:
    """Bring each part to where it stood.

    Raises:
        BadInput: a part is missing, unknown, or of another shape; nothing else may be said of the parts then.
    """
    missing, unknown = sorted(parts.keys() - state.keys()), sorted(state.keys() - parts.keys())
    if missing or unknown:
        told = [f"lacks {', '.join(missing)}"] * bool(missing) + [f"holds {', '.join(unknown)} too"] * bool(unknown)
        raise BadInput(f"the saved state {' and '.join(told)}; this run has {', '.join(parts)}", CURE)
    for name, part in parts.items():
        restore_part(name, part, state[name])


def restore_part(name: str, part: Stateful, state: Any) -> None:
    """Bring one part to where it stood.

    Raises:
        BadInput: it is of another shape or kind; tells the first tensor that differs.
    """
    fresh = part.state_dict()
    try:
        part.load_state_dict(state)
    except BadInput:
        raise
    except (RuntimeError, KeyError, ValueError, TypeError) as error:
        why = misfit(state, fresh, name) or one_line(str(error))[:200]
        raise BadInput(f"the saved {name} does not fit this run: {why}", CURE) from error


def load_exactly(name: str, module: Stateful, state: Mapping[str, Any]) -> None:
    """Load a state of exactly the module's own keys: TorchRL's functional losses pass over what does not fit.

    Raises:
        BadInput: a key is missing or unknown, or a tensor has another shape.
    """
    why = misfit(state, module.state_dict(), name)
    if why is not None:
        raise BadInput(f"the saved {name} does not fit this run: {why}", CURE)
    module.load_state_dict(state)


def misfit(saved: Any, fresh: Any, path: str) -> str | None:
    """The first tensor whose shape is another, or the first key that only one of two states has, in words."""
    if isinstance(saved, Tensor) and isinstance(fresh, Tensor):
        if saved.shape != fresh.shape:
            return f"{path} was saved with shape {tuple(saved.shape)}, this run's has {tuple(fresh.shape)}"
        return None
    if isinstance(saved, Mapping) and isinstance(fresh, Mapping):
        told = (misfit(saved[key], fresh[key], f"{path}.{key}") for key in fresh if key in saved)
        first = next((words for words in told if words is not None), None)
        alone = [(key, "only this run has") for key in fresh if key not in saved]
        alone += [(key, "only the saved state has") for key in saved if key not in fresh]
        if first is None and alone and fresh:
            return f"{alone[0][1]} {path}.{alone[0][0]}"
        return first
    return None
