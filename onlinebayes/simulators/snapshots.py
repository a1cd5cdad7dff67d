"""Snapshots of a simulator as plain tensors in dictionaries: for copies, and for checkpoints that go on exactly.

By default theta and state. A simulator that remembers more (a solver's warm start, who failed) is :class:`Resumable`:
without that a run that goes on from a checkpoint is not the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from tensordict import TensorDict

from onlinebayes.simulators.base import Simulator


@runtime_checkable
class Resumable(Protocol):
    """A simulator that can say exactly where it stands."""

    def snapshot(self) -> dict[str, Any]:
        """Everything that decides what its next step gives."""
        ...

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Stand where a snapshot was taken."""
        ...


def snapshot(simulator: Simulator) -> dict[str, Any]:
    """Return a snapshot of the simulator."""
    if isinstance(simulator, Resumable):
        return simulator.snapshot()
    return {"theta": simulator.theta, "state": dict(simulator.state.flatten_keys(".").items())}


def restore(simulator: Simulator, values: Mapping[str, Any]) -> None:
    """Let it stand there again."""
    if isinstance(simulator, Resumable):
        simulator.restore(values)
        return
    state = TensorDict(dict(values["state"]), batch_size=(simulator.worlds,)).unflatten_keys(".")
    simulator.reset(values["theta"], state)
