"""A corner plot: each parameter's marginal on the diagonal, each pair's density below it, truth and prior marked.

A log-scale parameter has a log axis, and its density counts per decade: on that axis its prior is flat. The contours
hold 68 and 95 % of the pair's mass.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from torch import Tensor

from onlinebayes.inference.distributions import BoxUniform
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import atomic_path

POSTERIOR, PRIOR, TRUTH = "#2a6f97", "#8a8f98", "#d1495b"
LEVELS = (0.95, 0.68)
LONGEST = 22
"""Letters of a name beside an axis; a longer one is broken at its last dot."""
NARROW = 1e-3
"""A window narrower than this part of its values is labelled by distances from a round number."""


@runtime_checkable
class Sampler(Protocol):
    """The interface that a corner plot needs of a distribution: draws."""

    @property
    def space(self) -> ParameterSpace:
        """The parameters."""
        ...

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Tensor:
        """Draw theta (*shape, P)."""
        ...


def corner(
    posterior: Sampler,
    *,
    truth: Float[Tensor, " P"] | None = None,
    prior: BoxUniform | None = None,
    zoom: bool = True,
    samples: int = 20_000,
    title: str = "",
) -> Figure:
    """Draw the posterior's marginals, singly and in pairs.

    Args:
        posterior: a :class:`~onlinebayes.inference.Posterior` or any distribution over its ``space``.
        truth: true parameters (P,) [units], drawn as lines, where they are known.
        prior: drawn as a dashed line on the diagonal; its bounds stand above.
        zoom: show where the posterior (and the truth) is; otherwise the parameters' whole bounds.
        samples: draws behind the densities.
        title: over the figure.

    Returns:
        a matplotlib figure of its own; nothing global is touched. Save it with :func:`save`.
    """
    space = posterior.space
    parameters = list(space.values())
    draws = _shown(posterior.sample((samples,), torch.Generator().manual_seed(0)), parameters)
    at = _shown(truth.reshape(1, -1), parameters)[0] if truth is not None else None
    edges = (
        _shown(prior.box.from_frame(torch.tensor([[0.0] * len(space), [1.0] * len(space)])), parameters).T
        if prior
        else None
    )
    windows = [_window(p, draws[:, i], None if at is None else at[i], zoom) for i, p in enumerate(parameters)]
    size = len(space)
    side = 2.1 if size > 1 else 3.2
    figure = Figure(figsize=(0.9 + side * size, 0.7 + side * size + (0.35 if title else 0)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(size, size, squeeze=False)
    for row in range(size):
        for column in range(size):
            axis = axes[row, column]
            if column > row:
                axis.set_visible(False)
                continue
            if row == column:
                _single(axis, draws[:, row], windows[row], None if edges is None else edges[row])
                if edges is not None:
                    axis.set_title(_bounds(parameters[row]), fontsize=7, color=PRIOR, pad=2)
            else:
                _pair(axis, draws[:, column], draws[:, row], windows[column], windows[row])
            _truth(axis, at, row, column)
            _label(axis, space, row, column)
    _legend(figure, axes[0, 0], prior is not None, truth is not None, title)
    return figure


def save(figure: Figure, path: str | Path, *, dpi: int = 150) -> None:
    """Write the figure to ``path`` (PNG, SVG or PDF by its suffix), whole or not at all."""
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=dpi)


def _shown(theta: Tensor, parameters: list[Parameter]) -> np.ndarray:
    """Theta (N, P) as plotted: the decimal logarithm of log-scale parameters."""
    values = theta.double().cpu().numpy().copy()
    for i, parameter in enumerate(parameters):
        if parameter.scale == "log":
            values[:, i] = np.log10(values[:, i])
    return values


def _window(parameter: Parameter, draws: np.ndarray, truth: float | None, zoom: bool) -> tuple[float, float]:
    bounds = (parameter.low, parameter.high)
    if parameter.scale == "log":
        bounds = (float(np.log10(parameter.low)), float(np.log10(parameter.high)))
    if not zoom:
        return bounds
    low, high = np.quantile(draws, [0.001, 0.999])
    if truth is not None:
        low, high = min(low, truth), max(high, truth)
    margin = 0.15 * (high - low) + 1e-9 * (bounds[1] - bounds[0])
    return max(bounds[0], low - margin), min(bounds[1], high + margin)


def _single(axis: Axes, draws: np.ndarray, window: tuple[float, float], prior: np.ndarray | None) -> None:
    edges = np.linspace(*window, 61)
    density = _smoothed(np.histogram(draws, edges)[0] / (len(draws) * (edges[1] - edges[0])))
    centres = (edges[1:] + edges[:-1]) / 2
    axis.fill_between(centres, density, color=POSTERIOR, alpha=0.3, lw=0)
    axis.plot(centres, density, color=POSTERIOR, lw=1.4)
    if prior is not None:
        low, high = max(prior[0], window[0]), min(prior[1], window[1])
        axis.plot([low, high], [1 / (prior[1] - prior[0])] * 2, color=PRIOR, lw=1.2, ls="--")
    axis.set_xlim(*window)
    axis.set_ylim(0, 1.08 * max(density.max(), 1e-300))
    axis.set_yticks([])


def _bounds(parameter: Parameter) -> str:
    """``prior 50 to 150 kg``."""
    return f"prior {parameter.low:.5g} to {parameter.high:.5g} {parameter.unit}".rstrip()


def _pair(
    axis: Axes, x: np.ndarray, y: np.ndarray, x_limits: tuple[float, float], y_limits: tuple[float, float]
) -> None:
    counts, x_edges, y_edges = np.histogram2d(x, y, bins=48, range=[x_limits, y_limits])
    counts = _smoothed(counts)
    flat = np.sort(counts.ravel())[::-1]
    mass = np.cumsum(flat) / flat.sum()
    heights = [float(flat[np.searchsorted(mass, level)]) for level in LEVELS]
    centres = (x_edges[1:] + x_edges[:-1]) / 2, (y_edges[1:] + y_edges[:-1]) / 2
    shown = np.ma.masked_less(counts.T, 0.02 * counts.max())
    axis.pcolormesh(x_edges, y_edges, shown, cmap="Blues", vmin=0, rasterized=True)
    if 0 < heights[0] < heights[1]:
        axis.contour(*centres, counts.T, levels=heights, colors=POSTERIOR, linewidths=(0.8, 1.2))
    axis.set_xlim(*x_limits)
    axis.set_ylim(*y_limits)


def _smoothed(counts: np.ndarray) -> np.ndarray:
    kernel = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16
    for axis in range(counts.ndim):
        # Reflected at the rim, so that a density that ends at a bound is not drawn fading towards it.
        padded = np.pad(counts, [(2, 2) if a == axis else (0, 0) for a in range(counts.ndim)], mode="symmetric")
        counts = np.apply_along_axis(lambda line: np.convolve(line, kernel, mode="valid"), axis, padded)
    return counts


def _truth(axis: Axes, truth: np.ndarray | None, row: int, column: int) -> None:
    if truth is None:
        return
    axis.axvline(truth[column], color=TRUTH, lw=1.0, zorder=3, clip_on=False)
    if row != column:
        axis.axhline(truth[row], color=TRUTH, lw=1.0, zorder=3, clip_on=False)
        axis.plot(truth[column], truth[row], "o", color=TRUTH, ms=4, zorder=4, clip_on=False)


def _label(axis: Axes, space: ParameterSpace, row: int, column: int) -> None:
    last, names = row == len(space) - 1, list(space)
    across = _ticks(axis.xaxis, axis.get_xlim(), 3, names[column], space[names[column]])
    axis.tick_params(labelsize=8, labelbottom=last, labelleft=column == 0 and row > 0)
    if last:
        axis.set_xlabel(across, fontsize=9)
    if row != column:
        along = _ticks(axis.yaxis, axis.get_ylim(), 4, names[row], space[names[row]])
        if column == 0:
            axis.set_ylabel(along, fontsize=9)
    for side in ("top", "right") + (("left",) if row == column else ()):
        axis.spines[side].set_visible(False)


def _ticks(axis: Axis, window: tuple[float, float], count: int, name: str, parameter: Parameter) -> str:
    """Place and format an axis' ticks; gives its title, which says what the numbers are."""
    logarithmic = parameter.scale == "log"
    # Whole decades where the window holds at least two of them.
    axis.set_major_locator(MaxNLocator(count, integer=logarithmic and window[1] - window[0] > 2))
    low, high = (10**edge if logarithmic else edge for edge in window)
    if high - low < NARROW * max(abs(low), abs(high)):
        # What is known to many digits is told by how far it lies from a round number.
        centre = round((low + high) / 2, -math.ceil(math.log10(high - low)))
        power = math.floor(math.log10(max(abs(low - centre), abs(high - centre))))
        axis.set_major_formatter(
            FuncFormatter(lambda value, _: f"{((10**value if logarithmic else value) - centre) / 10.0**power:.3g}")
        )
        return _title(name, f"- {centre:.12g} [1e{power} {parameter.unit}]".replace(" ]", "]"))
    if logarithmic:
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{10**value:.3g}"))
    return _title(name, f"[{parameter.unit}]" if parameter.unit else "")


def _title(name: str, rest: str) -> str:
    """``length [m]``; where that is too long, ``dry_friction@carriage`` above ``.frictionloss [N]``."""
    head, dot, tail = name.rpartition(".")
    if len(f"{name} {rest}") > LONGEST:
        name = f"{head}\n{dot}{tail}" if head else f"{name}\n"
    return f"{name} {rest}".strip().replace("\n ", "\n")


def _legend(figure: Figure, axis: Axes, prior: bool, truth: bool, title: str) -> None:
    handles = [axis.plot([], [], color=POSTERIOR, lw=2, label="posterior")[0]]
    if prior:
        handles.append(axis.plot([], [], color=PRIOR, lw=1.2, ls="--", label="prior")[0])
    if truth:
        handles.append(axis.plot([], [], color=TRUTH, lw=1.2, label="truth")[0])
    figure.legend(handles=handles, loc="outside upper right", fontsize=8, frameon=False, ncols=len(handles))
    if title:
        figure.suptitle(title, fontsize=10, x=0.02, ha="left")
