"""What is the same in every round of a search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement
from onlinebayes.runs import UNWATCHED, Watch
from onlinebayes.simulators.effects import Effect


@dataclass(frozen=True)
class SearchContext:
    """The fit runs, how effects are judged, which of them, and who watches.

    Args:
        measurement: the fit runs.
        selection: how effects are judged.
        candidates: which effects to try (see :func:`.candidates.candidates.propose`).
        watch: takes lines of progress, and is looked at between rounds and between the fits of a round.
    """

    measurement: Measurement
    selection: Selection
    candidates: str | Sequence[str | Effect] = "all"
    watch: Watch = UNWATCHED

    @property
    def everything(self) -> bool:
        """Whether nobody named effects: then those of much freedom are tried, too."""
        return isinstance(self.candidates, str) and self.candidates == "all"
