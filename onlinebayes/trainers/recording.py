"""Watches a run and leaves ``run.rrd``, ``run.html`` and curves for TensorBoard, or another logger, in its folder.

The recording grows with every step; the page is written when the run ends or stops.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference import Belief, BoxUniform, extended, plots
from onlinebayes.inference.calibration import LEVELS
from onlinebayes.loggers import Loggers, RunRecorder, tensorboard, write_page
from onlinebayes.trainers.playing import Episode, Player
from onlinebayes.trainers.provenance import made_by
from onlinebayes.trainers.run_page import page, quantiles_of
from onlinebayes.trainers.state import OnlineState, Record

SECONDS = 10.0  # of an episode on the time line where nobody plays one


@dataclass
class Recording:
    """Is told of every step; as a context it writes the page at its end, however that comes.

    Args:
        folder: of the run.
        name: of the recipe.
        prior: over the parameters.
        player: plays episodes; without it there are none.
        truth: parameters of the hidden system (P,), where they are known.
        further: true values of parameters that the model may get while the run learns, by name.
        baselines: returns of other runs by their kind, drawn beside this one's.
        infers: whether there is a belief to show, and not a policy that learns alone.
        loggers: are told all scalars, besides the recording.
    """

    folder: Path
    name: str
    prior: Belief
    player: Player | None = None
    truth: Float[Tensor, " P"] | None = None
    baselines: Mapping[str, float] = field(default_factory=dict)
    infers: bool = True
    further: Mapping[str, float] = field(default_factory=dict)
    loggers: Loggers = tensorboard
    _recorder: RunRecorder | None = field(default=None, init=False)
    _last: tuple[OnlineState, np.ndarray | None, Mapping[str, Episode]] | None = field(default=None, init=False)

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._last is not None:
            state, corner, played = self._last
            content = page(
                self.name,
                state,
                truth=self._truth(state),
                corner=corner,
                played=played,
                baselines=self.baselines,
                made=made_by(self.folder),
            )
            write_page(content, self.folder / "run.html")
        if self._recorder is not None:
            self._recorder.close()

    def __call__(self, state: OnlineState) -> None:
        """Record a complete step."""
        played = {} if self.player is None else self.player(state)
        recorder, record = self._opened(played), state.records[-1]
        self._follow(recorder, state)
        corner = self._corner(state) if self.infers else None
        recorder.step(record.step, _scalars(record))
        before = state.records[-2].frames if len(state.records) > 1 else 0
        recorder.seconds(record.step, record.seconds, record.frames - before)
        if "return" in record.figures:
            recorder.returns(record.step, {"this run": record.figures["return"], **self.baselines})
        if record.calibration:
            recorder.calibration(record.step, LEVELS, record.calibration)
        if corner is not None:
            recorder.belief(record.step, state.belief, state.proposal)
            recorder.picture(record.step, "corner", corner)
        recorder.summary(record.step, _summary(self.name, record, self.infers))
        for name, episode in played.items():
            recorder.episode(record.step, name, episode.shapes, episode.poses, episode.dt, ghost=name == "simulated")
        recorder.flush()
        self._last = (state, corner, played)

    def _opened(self, played: Mapping[str, Episode]) -> RunRecorder:
        if self._recorder is None:
            seconds = max((each.longest * each.dt for each in played.values()), default=SECONDS)
            self._recorder = RunRecorder(
                self.folder,
                self.name,
                self.prior.space,
                seconds=seconds,
                truth=self.truth,
                loggers=self.loggers(self.folder),
            )
        return self._recorder

    def _follow(self, recorder: RunRecorder, state: OnlineState) -> None:
        """Show the parameters that the model has got, and say when it did."""
        if recorder.space.names != state.belief.space.names:
            recorder.grow(state.belief.space, self._truth(state))
        record = state.records[-1]
        before = state.records[-2].grown if len(state.records) > 1 else ()
        for effect in (effect for effect in record.grown if effect not in before):
            recorder.event(record.step, f"the model grew: {effect}")

    def _truth(self, state: OnlineState) -> Float[Tensor, " P"] | None:
        """True values of the present parameters; nan where one is not known."""
        if self.truth is None:
            return None
        names = state.belief.space.names[len(self.truth) :]
        return torch.cat([self.truth, self.truth.new_tensor([self.further.get(name, math.nan) for name in names])])

    def _corner(self, state: OnlineState) -> np.ndarray:
        belief = state.belief
        box = extended(self.prior, belief.space) if isinstance(self.prior, BoxUniform) else None
        assert box is None or isinstance(box, BoxUniform)
        figure = plots.corner(belief, truth=self._truth(state), prior=box, title=self.name)
        figure.canvas.draw()
        return np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()  # type: ignore[attr-defined]


def _scalars(record: Record) -> dict[str, float]:
    values = {f"figures/{name}": value for name, value in record.figures.items() if name != "return"}
    values |= {f"losses/{name}": value for name, value in record.losses.items()}
    values["frames"] = float(record.frames)
    if "criticism" in record.seconds or record.grown:
        values["criticism/effects added"] = float(len(record.grown))
    if record.fit is not None and record.fit.validation:
        values["fit/validation loss"] = min(record.fit.validation)
    if record.coverage is not None:
        values["fit/coverage of the 95 % region"] = record.coverage
    return values


def _summary(name: str, record: Record, infers: bool) -> str:
    figures = "".join(f"\n| {key} | {value:.4g} |" for key, value in record.figures.items())
    each = {name: quantiles_of(record, name) for name in record.belief} if infers else {}
    belief = "".join(
        f"\n| {key} | {middle:.4g} ({low:.4g} to {high:.4g}) |" for key, (low, middle, high) in each.items()
    )
    notes = "".join(f"\n- {note}" for note in record.notes)
    grown = "".join(f"\n\n**The model has got {effect}.**" for effect in record.grown)
    table = f"| | |\n|---|---|\n| frames | {record.frames} |{figures}{belief}"
    return f"# {name}, step {record.step}{grown}\n\n{table}\n{notes}\n"
