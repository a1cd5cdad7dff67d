"""A training run as a Rerun recording: belief and proposal over time, returns, losses, seconds, episodes that move.

| entity                                   | content                                                    |
|------------------------------------------|------------------------------------------------------------|
| ``summary``                              | Markdown: what stands after the step                       |
| ``events``                               | log lines on what happened, such as a model that grew      |
| ``criticism/``                           | how many effects criticism has added                       |
| ``belief/PARAMETER/mean|low|high|truth`` | mean and 90 % interval, the truth where it is known        |
| ``proposal/PARAMETER/low|high``          | 90 % interval of where simulations are drawn               |
| ``marginals/PARAMETER/belief|proposal``  | histograms                                                 |
| ``corner``, ``calibration``              | pictures: the belief's pairs; coverage over nominal level  |
| ``returns/``                             | of the policy and of baselines, in one view                |
| ``figures/``, ``losses/``, ``fit/``      | what a judge says; policy losses; coverage, validation     |
| ``seconds/``, ``speed/``                 | where the time of each step went; frames a second          |
| ``episodes/NAME/SHAPE``                  | the system's shapes along an episode                       |

Everything stands on two time lines: ``step``, and ``time``, on which the steps' episodes are played one after the other
while curves and belief grow.

A run that goes on after a stop writes ``run-2.rrd`` and so on with the recording id of the first: the viewer shows them
as one. Nothing here knows a trainer; a belief is anything with ``space`` and ``sample``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torchrl.record.loggers import Logger

from onlinebayes.loggers import charts, layout
from onlinebayes.loggers.shapes import alike, archetype
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, check_room
from onlinebayes.runs.recordings import copy_whole, whole_bytes
from onlinebayes.simulators import Shape
from onlinebayes.simulators.drawing import View, view_of

if TYPE_CHECKING:
    from rerun import RecordingStream

DRAWS = 2000
LEVELS = (0.05, 0.95)
BINS = 40
MOST_BYTES = 40_000_000
MOST_POSES = 500
PLAYED = 60.0  # seconds in which the viewer plays a run


@runtime_checkable
class Sampler(Protocol):
    """The interface of a belief or a proposal."""

    @property
    def space(self) -> ParameterSpace:
        """The parameters."""
        ...

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Tensor:
        """Draw theta (*shape, P)."""
        ...


class RunRecorder:
    """Writes one run's recording; the file is made when the first thing is told.

    Args:
        folder: of the run.
        name: of the recipe.
        space: the parameters.
        seconds: longest episode [s].
        truth: their true values (P,), where they are known.
        loggers: TorchRL's, e.g. :func:`~onlinebayes.loggers.tensorboard`: they are told all scalars.
        most: size at which pictures and episodes of ever fewer steps are kept [bytes]; scalars always are.
    """

    def __init__(
        self,
        folder: str | Path,
        name: str,
        space: ParameterSpace,
        *,
        seconds: float,
        truth: Float[Tensor, " P"] | None = None,
        loggers: Sequence[Logger] = (),
        most: int = MOST_BYTES,
    ) -> None:
        self.space, self.truth, self.loggers, self.most = space, truth, loggers, most
        found = Path(folder).glob("run*.rrd")
        self._earlier = [path for path in found if re.fullmatch(r"run(-\d+)?\.rrd", path.name)]
        number = max((int(path.stem[4:] or 1) for path in self._earlier), default=0) + 1
        self.path = Path(folder) / ("run.rrd" if number == 1 else f"run-{number}.rrd")
        self._id = f"{name}-{Path(folder).resolve().name}"
        self._slot = 1.1 * seconds  # of each step on the time line ``time``
        self._opened: RecordingStream | None = None
        self._scalars: dict[str, None] = {}  # in the order of their first appearance
        self._pictures: dict[str, None] = {}
        self._drawn: dict[str, Shape] = {}
        self._view: View | None = None
        self._layout: tuple[Any, ...] = ()
        self._events = False
        self._step = 1

    def step(self, step: int, values: Mapping[str, float]) -> None:
        """Scalars of one step by entity: ``figures/return``, ``losses/loss_actor``, ``seconds/fit``."""
        self._curves(step, values)
        for logger in self.loggers:
            for name, value in values.items():
                logger.log_scalar(name, float(value), step)

    def returns(self, step: int, values: Mapping[str, float]) -> None:
        """Returns by who made them: ``online``, ``oracle``, ``posterior-first``, ``prior``, or any other name."""
        self.step(step, {f"returns/{name}": value for name, value in values.items()})

    def seconds(self, step: int, seconds: Mapping[str, float], frames: int | None = None) -> None:
        """Record the seconds of each part of a step, and over all of them how fast its simulated frames came."""
        values = {f"seconds/{name}": value for name, value in seconds.items()}
        total = sum(seconds.values())
        self.step(step, values | ({"speed/frames a second": frames / total} if frames is not None and total else {}))

    def calibration(self, step: int, levels: Sequence[float], coverage: Sequence[float]) -> None:
        """Share of held-out truths in the regions of these nominal levels, each in [0, 1]."""
        chart = charts.calibration([float(v) for v in levels], [float(v) for v in coverage])
        self.picture(step, "calibration", charts.to_pixels(chart))

    def summary(self, step: int, text: str) -> None:
        """Record the summary of a step, in Markdown."""
        import rerun as rr

        self._at(step).log("summary", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def event(self, step: int, text: str) -> None:
        """One line on what happened, among the recording's log lines."""
        import rerun as rr

        self._at(step).log("events", rr.TextLog(text, level=rr.TextLogLevel.INFO))
        self._events = True

    def grow(self, space: ParameterSpace, truth: Float[Tensor, " P"] | None = None) -> None:
        """Go on with other parameters, and their true values (nan where one is not known)."""
        self.space, self.truth = space, truth

    def belief(self, step: int, belief: Sampler, proposal: Sampler | None = None) -> None:
        """Intervals and histograms of belief and proposal, parameter by parameter."""
        values: dict[str, float] = {}
        drawn: dict[str, Tensor] = {}
        for name, sampler in (("belief", belief), ("proposal", proposal)):
            if sampler is None:
                continue
            draws = drawn[name] = sampler.sample((DRAWS,), torch.Generator().manual_seed(0))
            low, high = torch.quantile(draws, draws.new_tensor(LEVELS), dim=0)
            for i, parameter in enumerate(self.space.names):
                if name == "belief":
                    values[f"belief/{parameter}/mean"] = float(draws[:, i].mean())
                values |= {f"{name}/{parameter}/low": float(low[i]), f"{name}/{parameter}/high": float(high[i])}
        if self.truth is not None:
            told = zip(self.space.names, self.truth.tolist(), strict=True)
            values |= {f"belief/{name}/truth": value for name, value in told if not math.isnan(value)}
        self._curves(step, values)
        for i, parameter in enumerate(self.space.names):
            self._marginal(step, parameter, {name: draws[:, i].double().cpu().numpy() for name, draws in drawn.items()})

    def picture(self, step: int, name: str, pixels: np.ndarray) -> None:
        """A picture (H, W, 3), 8 bits a colour, e.g. a corner plot."""
        import rerun as rr

        if self._room(step):
            self._pictures.setdefault(name)
            image = rr.Image(np.ascontiguousarray(pixels)).compress(jpeg_quality=85)
            self._at(step).log(layout.path(name), image)

    def episode(
        self,
        step: int,
        name: str,
        shapes: Sequence[Shape],
        poses: Float[Tensor, "T S 7"],
        dt: float,
        *,
        ghost: bool = False,
    ) -> None:
        """An episode as moving shapes, on the time line ``time``.

        Args:
            step: after which it was played.
            name: of the system that played it: "real", "simulated".
            shapes, poses: see ``onlinebayes.simulators.Drawable``.
            dt: between two poses [s].
            ghost: draw wireframes, for the second of two that lie on each other.
        """
        import rerun as rr

        if not len(poses) or not self._room(step):
            return
        if self._view is None:
            self._view = view_of(shapes, poses)
        stride = -(-len(poses) // MOST_POSES)
        kept = poses[::stride].detach().float().cpu()
        times = (step - 1) * self._slot + np.arange(len(kept)) * dt * stride
        stream = self._at(step)
        for i, shape in enumerate(shapes):
            entity = layout.path("episodes", name, shape.name)
            if not alike(self._drawn.get(entity), shape):
                stream.log(entity, archetype(shape, ghost=ghost))
                self._drawn[entity] = shape
            moving = slice(None) if shape.moving else slice(1)
            where = rr.Transform3D.columns(
                translation=kept[moving, i, :3].numpy(), quaternion=kept[moving, i][:, [4, 5, 6, 3]].numpy()
            )
            steps = np.full(len(times), step)[moving]
            columns = [rr.TimeColumn("time", duration=times[moving]), rr.TimeColumn("step", sequence=steps)]
            stream.send_columns(entity, columns, where)

    def flush(self) -> None:
        """Write what is pending: whoever opens the file now sees everything so far."""
        if self._opened is not None:
            self._arrange()
            check_room(self.path)
            self._opened.flush()

    def close(self) -> None:
        """Write what is pending and close the file."""
        if self._opened is not None:
            self._arrange()
            check_room(self.path)
            self._opened.flush()
            self._opened.disconnect()
            self._opened = None

    @property
    def _stream(self) -> RecordingStream:
        import rerun as rr  # 0.7 s: only when there is something to record

        if self._opened is None:
            for path in self._earlier:  # the viewer refuses what a kill cut within a message
                if whole_bytes(path) < path.stat().st_size:
                    copy_whole(path, path)
            self._opened = rr.RecordingStream("onlinebayes", recording_id=self._id, send_properties=False)
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._opened.save(self.path)
            except (OSError, RuntimeError) as error:
                raise BadInput(
                    f"cannot be written: {error}", "choose a folder you may write to", where=str(self.path)
                ) from error
        return self._opened

    def _at(self, step: int) -> RecordingStream:
        """The stream, both of its time lines at the beginning of a step's episode."""
        stream = self._stream
        self._step = max(self._step, step)
        stream.set_time("step", sequence=step)
        stream.set_time("time", duration=(step - 1) * self._slot)
        return stream

    def _curves(self, step: int, values: Mapping[str, float]) -> None:
        import rerun as rr

        stream = self._at(step)
        for name, value in values.items():
            parts = name.split("/")
            if name not in self._scalars:
                index = sum(other.split("/")[0] == parts[0] for other in self._scalars)
                stream.log(layout.path(*parts), layout.style(name, index), static=True)
                self._scalars[name] = None
            stream.log(layout.path(*parts), rr.Scalars(float(value)))

    def _marginal(self, step: int, name: str, draws: Mapping[str, np.ndarray]) -> None:
        """Densities of a parameter on common bins."""
        import rerun as rr

        stream, edges = self._at(step), _edges(self.space[name], np.concatenate(list(draws.values())))
        for who, values in draws.items():
            heights = np.histogram(values, edges)[0] / (len(values) * np.diff(edges))
            colour = [42, 111, 151, 255] if who == "belief" else [138, 143, 152, 120]
            centres = (edges[1:] + edges[:-1]) / 2
            chart = rr.BarChart(heights, color=colour, abscissa=centres, widths=np.diff(edges))
            stream.log(layout.path("marginals", name, who), chart)

    def _room(self, step: int) -> bool:
        """Check whether a step keeps pictures and episodes: all until half of the bytes are spent, then ever fewer."""
        spent = sum(path.stat().st_size for path in (*self._earlier, self.path) if path.exists())
        halvings = 0
        while spent > self.most * (1 - 0.5 ** (halvings + 1)) and halvings < 8:
            halvings += 1
        return step % 4**halvings == 0

    def _arrange(self) -> None:
        """Send the layout where it has changed."""
        # The whole run in some PLAYED seconds; told anew when its length has doubled.
        speed = max(1.0, 2.0 ** math.ceil(math.log2(self._step * self._slot / PLAYED)))
        now = (speed, self.space.names, tuple(self._scalars), tuple(self._pictures), self._view, self._events)
        if self._opened is not None and now != self._layout:
            self._opened.send_blueprint(
                layout.blueprint(
                    self.space, list(self._scalars), list(self._pictures), self._view, speed, events=self._events
                )
            )
            self._layout = now


def _edges(parameter: Parameter, draws: Float[np.ndarray, " M"]) -> Float[np.ndarray, " E"]:
    """Bins that hold the draws; even in the logarithm where the parameter's scale is that."""
    low, high = float(draws.min()), float(draws.max())
    if parameter.scale == "log" and low > 0:
        return np.geomspace(low, max(high, low * (1 + 1e-9)), BINS + 1)
    return np.linspace(low, max(high, low + 1e-12), BINS + 1)
