"""A run that no trainer of ours makes, told by whoever makes it: it leaves what every run leaves.

    with Journal("out/mine", "mine", prior, player, truth) as journal:
        for batch in collector:
            ...
            journal.step("policy", frames=batch.numel(), losses=losses, figures={"return": ...})
        journal.step("fit", belief=posterior)

``run.json``, ``log.csv``, ``run.rrd``, ``run.html`` and curves for TensorBoard; begun anew in the same folder, it takes
the place of the run before.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import TracebackType

from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference import Belief
from onlinebayes.runs import RunFolder
from onlinebayes.trainers.playing import Player
from onlinebayes.trainers.recording import Recording
from onlinebayes.trainers.session import Say, Watcher, say_aloud, tell
from onlinebayes.trainers.state import OnlineState


class Journal:
    """Keeps the journal of one run; as a context it holds the folder, and writes the page at its end.

    Args:
        folder: of the run.
        name: of the recipe.
        prior: over the parameters.
        player: plays episodes; without it there are none.
        truth: parameters of the hidden system (P,), where they are known.
        baselines: returns of others by their name, drawn beside this one's.
        say: is told each step in words.
        watchers: told after each step too, such as :class:`~onlinebayes.trainers.PolicyFiles`.

    Raises:
        BadInput: at entry, a folder that cannot be written, or is that of another recipe.
    """

    def __init__(
        self,
        folder: str | Path,
        name: str,
        prior: Belief,
        player: Player | None = None,
        truth: Float[Tensor, " P"] | None = None,
        baselines: Mapping[str, float] | None = None,
        say: Say = say_aloud,
        watchers: Sequence[Watcher] = (),
    ) -> None:
        self.state = OnlineState.begin(prior)
        self._folder = RunFolder(folder, name)
        self._recording = Recording(self._folder.folder, name, prior, player, truth, baselines or {})
        self._watchers: tuple[Watcher, ...] = (self._recording, *watchers)
        self._last, self._say = time.monotonic(), say

    def __enter__(self) -> Journal:
        self._folder.__enter__()
        for earlier in ("run.rrd", "run-[0-9]*.rrd"):
            for path in self._folder.folder.glob(earlier):
                path.unlink()
        shutil.rmtree(self._folder.path("tensorboard"), ignore_errors=True)
        self._last = time.monotonic()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._recording.__exit__(kind, error, trace)
        finally:
            self._folder.__exit__(kind, error, trace)

    def step(
        self,
        part: str,
        *,
        seconds: float | None = None,
        frames: int = 0,
        simulated: int = 0,
        losses: Mapping[str, float] | None = None,
        figures: Mapping[str, float] | None = None,
        belief: Belief | None = None,
        notes: Sequence[str] = (),
    ) -> None:
        """Tell of one step.

        Args:
            part: of the work.
            seconds: that it took [s]; those since the step before without it.
            frames: simulated, that the policy learnt from in it.
            simulated: frames that the belief learnt from in it.
            losses: of the policy, by name.
            figures: what a judge says; a ``"return"`` is drawn beside the baselines.
            belief: from now on; as before without it.
            notes: what was decided, or went wrong.
        """
        state, took = self.state, time.monotonic() - self._last if seconds is None else seconds
        state.frames, state.simulated = state.frames + frames, state.simulated + simulated
        state.belief = belief if belief is not None else state.belief
        state.losses, state.batches, state.notes = dict(losses or {}), 1, list(notes)
        state.complete({part: took}, None)
        state.records[-1] = replace(state.records[-1], figures=dict(figures or {}))
        tell(state, self._folder, self._watchers, self._say)
        self._last = time.monotonic()
