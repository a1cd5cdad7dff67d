"""A blind case by name, as studies share them out among processes and keep what came of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final


@final
@dataclass(frozen=True)
class Job:
    """A case to work on.

    Args:
        rig: of ``envs/rigs``, or another machine that a study knows.
        kind: of the case.
        seed: which one of that kind.
    """

    rig: str
    kind: str
    seed: int

    @property
    def name(self) -> str:
        """``rig-kind-seed``."""
        return f"{self.rig}-{self.kind}-{self.seed}"
