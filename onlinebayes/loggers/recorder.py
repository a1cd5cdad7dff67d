"""A training run as a Rerun recording: belief and proposal over time, returns, losses, seconds, episodes that move.

| entity                                 | content                                                    |
|----------------------------------------|------------------------------------------------------------|
| ``summary``                            | Markdown: what stands after the step                       |
| ``belief/PARAMETER/mean|low|high|truth`` | mean and 90 % interval, the truth where it is known      |
| ``proposal/PARAMETER/low|high``        | 90 % interval of where simulations are drawn               |
| ``corner``                             | picture: the belief's marginals and pairs                  |
| ``figures/``, ``losses/``, ``fit/``    | returns and densities; policy losses; coverage, validation |
| ``seconds/``                           | where the time of each step went                           |
| ``episodes/NAME/SHAPE``                | the system's shapes along an episode                       |

Everything stands on two time lines: ``step``, and ``time``, on which the steps' episodes are played one after the other
while curves and belief grow.

A run that goes on after a stop writes ``run-2.rrd`` and so on with the recording id of the first: the viewer shows them
as one. Nothing here knows a trainer; a belief is anything with ``space`` and ``sample``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import ParameterSpace
from onlinebayes.simulators import Shape

if TYPE_CHECKING:
    from rerun import RecordingStream

DRAWS = 2000
LEVELS = (0.05, 0.95)


@runtime_checkable
class Sampler(Protocol):
    """What is asked of a belief or a proposal."""

    @property
    def space(self) -> ParameterSpace:
        """The parameters."""
        ...

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Tensor:
        """Draw theta (*shape, P)."""
        ...


class RunRecorder:
    """Writes one run's recording.

    Args:
        folder: of the run.
        name: of the recipe.
        space: the parameters.
        seconds: longest episode [s].
        truth: their true values (P,), where they are known.
    """

    def __init__(
        self,
        folder: str | Path,
        name: str,
        space: ParameterSpace,
        *,
        seconds: float,
        truth: Float[Tensor, " P"] | None = None,
    ) -> None:
        import rerun as rr  # 0.7 s: only when a recording is wanted

        self.space, self.truth = space, truth
        number = len(list(Path(folder).glob("run*.rrd"))) + 1
        self.path = Path(folder) / ("run.rrd" if number == 1 else f"run-{number}.rrd")
        self._stream: RecordingStream = rr.RecordingStream(
            "onlinebayes", recording_id=f"{name}-{Path(folder).name}", send_properties=False
        )
        self._stream.save(self.path)
        self._stream.send_blueprint(_blueprint(space))
        self._slot = 1.1 * seconds  # of each step on the time line ``time``

    def step(self, step: int, values: Mapping[str, float]) -> None:
        """Scalars of one step by entity: ``figures/return``, ``losses/loss_actor``, ``seconds/fit``."""
        import rerun as rr

        self._at(step)
        for name, value in values.items():
            self._stream.log([*name.split("/")], rr.Scalars(float(value)))

    def summary(self, step: int, text: str) -> None:
        """What stands after a step, in Markdown."""
        import rerun as rr

        self._at(step)
        self._stream.log("summary", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def belief(self, step: int, belief: Sampler, proposal: Sampler | None = None) -> None:
        """Intervals of belief and proposal, parameter by parameter."""
        values: dict[str, float] = {}
        for name, sampler in (("belief", belief), ("proposal", proposal)):
            if sampler is None:
                continue
            draws = sampler.sample((DRAWS,), torch.Generator().manual_seed(0))
            low, high = torch.quantile(draws, draws.new_tensor(LEVELS), dim=0)
            for i, parameter in enumerate(self.space.names):
                if name == "belief":
                    values[f"belief/{parameter}/mean"] = float(draws[:, i].mean())
                values |= {f"{name}/{parameter}/low": float(low[i]), f"{name}/{parameter}/high": float(high[i])}
        if self.truth is not None:
            values |= {f"belief/{n}/truth": float(v) for n, v in zip(self.space.names, self.truth, strict=True)}
        self.step(step, values)

    def picture(self, step: int, name: str, pixels: np.ndarray) -> None:
        """A picture (H, W, 3), 8 bits a colour, e.g. a corner plot."""
        import rerun as rr

        self._at(step)
        self._stream.log(name, rr.Image(np.ascontiguousarray(pixels)).compress(jpeg_quality=85))

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

        times = (step - 1) * self._slot + np.arange(len(poses)) * dt
        for i, shape in enumerate(shapes):
            entity = f"episodes/{name}/{shape.name}"
            self._at(step)
            self._stream.log(entity, _archetype(shape, ghost))
            moving = slice(None) if shape.moving else slice(1)
            where = rr.Transform3D.columns(
                translation=poses[moving, i, :3].numpy(), quaternion=poses[moving, i][:, [4, 5, 6, 3]].numpy()
            )
            steps = np.full(len(times), step)[moving]
            columns = [rr.TimeColumn("time", duration=times[moving]), rr.TimeColumn("step", sequence=steps)]
            self._stream.send_columns(entity, columns, where)

    def _at(self, step: int) -> None:
        """Set both time lines to the beginning of a step's episode."""
        self._stream.set_time("step", sequence=step)
        self._stream.set_time("time", duration=(step - 1) * self._slot)

    def flush(self) -> None:
        """Write what is pending: whoever opens the file now sees everything so far."""
        self._stream.flush()

    def close(self) -> None:
        """Write what is pending and close the file."""
        self._stream.flush()
        self._stream.disconnect()


def _archetype(shape: Shape, ghost: bool) -> Any:
    import rerun as rr

    colour = [round(255 * part) for part in shape.colour]
    fill = rr.components.FillMode.MajorWireframe if ghost else rr.components.FillMode.Solid
    style: dict[str, Any] = {"colors": [colour], "fill_mode": fill}
    match shape.kind:
        case "box" | "plane":
            return rr.Boxes3D(half_sizes=[shape.size], **style)
        case "sphere":
            return rr.Ellipsoids3D(half_sizes=[[shape.size[0]] * 3], **style)
        case "ellipsoid":
            return rr.Ellipsoids3D(half_sizes=[shape.size], **style)
        case "cylinder":
            return rr.Cylinders3D(lengths=[2 * shape.size[1]], radii=[shape.size[0]], **style)
        case "capsule":  # Rerun's begins at its origin, ours is centred
            start = [[0.0, 0.0, -shape.size[1]]]
            return rr.Capsules3D(lengths=[2 * shape.size[1]], radii=[shape.size[0]], translations=start, **style)
    assert shape.vertices is not None
    faces = None if shape.faces is None else shape.faces.numpy()
    return rr.Mesh3D(vertex_positions=shape.vertices.numpy(), triangle_indices=faces, albedo_factor=colour)


def _blueprint(space: ParameterSpace) -> Any:
    """Belief on the left, what the policy gains in the middle, the episode on the right, the rest in tabs below."""
    import rerun.blueprint as rrb

    beliefs = [
        rrb.TimeSeriesView(name=f"{name} [{space[name].unit}]", contents=[f"belief/{name}/**", f"proposal/{name}/**"])
        for name in space.names
    ]
    curves = [
        rrb.TimeSeriesView(name="return and density", contents="figures/**"),
        rrb.TimeSeriesView(name="coverage and fit", contents="fit/**"),
        rrb.TimeSeriesView(name="policy losses", contents="losses/**"),
        rrb.TimeSeriesView(name="seconds", contents="seconds/**"),
    ]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial3DView(name="real (solid) and simulated (wireframe)", contents="episodes/**"),
                rrb.Tabs(
                    rrb.Spatial2DView(name="belief", contents="corner"),
                    rrb.TextDocumentView(name="summary", contents="summary"),
                ),
            ),
            rrb.Horizontal(*beliefs, rrb.Tabs(*curves)),
            row_shares=[3, 2],
        ),
        rrb.TimePanel(timeline="time"),
        collapse_panels=True,
    )
