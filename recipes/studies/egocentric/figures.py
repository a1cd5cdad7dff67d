"""Figures 3.4 to 3.7 of the thesis, from our pipeline; published runs beside them where the recorded rows hold them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from envs.egocentric import CLASSES, PolicyRun, Sequences, Stretches
from onlinebayes.inference.plots import POSTERIOR, PRIOR, TRUTH
from recipes.sensor_choice import outcome
from recipes.studies.egocentric.pipeline import Seen

NAMES = (
    *("walking", "walking upstairs", "walking downstairs", "elevator up", "elevator down", "escalator up"),
    *("escalator down", "sitting", "eating", "drinking", "texting", "phone calls", "working on pc", "reading"),
    *("writing", "organizing files", "running", "push-ups", "sit-ups", "cycling"),
)
MOTION_MAH, CAMERA_MAH = 150.0, 300.0
"""Of an hour (Figure 3.7: 150 and 450 mAh)."""


def energy(use: float) -> float:
    """Charge that an hour takes [mAh]."""
    return MOTION_MAH + CAMERA_MAH * use


def of_activity(seen: Stretches, sequences: Sequences, values: Tensor) -> Tensor:
    """Mean of values (E, T) over the seconds of each activity."""
    label = sequences.label[seen.sequence][:, None].expand(values.shape)[seen.there]
    total = torch.bincount(label, values[seen.there].double(), CLASSES)
    return total / torch.bincount(label, minlength=CLASSES)


def figure_3_4(seen: Seen) -> Figure:
    """Reward and use of the camera while the policy learns; lambda and cost differ from episode to episode."""
    figure, (above, below) = _panels(2, 1, (5.2, 4.6))
    episodes, reward, used = (np.array(column) for column in zip(*seen.learning, strict=True))
    above.plot(episodes, reward, color=POSTERIOR)
    above.set_ylabel("mean reward a second")
    below.plot(episodes, used, color=POSTERIOR, label="camera")
    below.plot(episodes, 1 - used, color=PRIOR, label="motion")
    below.set(xlabel="episodes", ylabel="share of seconds", ylim=(0, 1))
    below.legend(frameon=False)
    return figure


def figure_3_5(seen: Seen, sequences: Sequences) -> Figure:
    """Accuracy of each activity: one sensor alone, and the policy at three lambdas."""
    figure, (axes,) = _panels(1, 1, (9.0, 4.2))
    test = seen.test
    bars = {"motion alone": test.motion_right.float(), "camera alone": test.vision_rate}
    for trade in (0.0, 0.2, 0.4):
        camera = seen.chosen["actor-critic"][trade]
        bars[f"policy, lambda {trade:g}"] = torch.where(camera, test.vision_rate, test.motion_right.float())
    told = {name: of_activity(test, sequences, values) for name, values in bars.items()}
    _bars(axes, told, (PRIOR, TRUTH, "#bcd4e6", "#6ba3c7", POSTERIOR))
    axes.set_ylabel("accuracy, by sequence")
    return figure


def figure_3_6(seen: Seen, sequences: Sequences, published: PolicyRun) -> Figure:
    """Mean probability of the camera in each activity at lambda = .2, and how often the published policy took it."""
    figure, (axes,) = _panels(1, 1, (9.0, 4.2))
    theirs = torch.bincount(published.label, published.action.double(), CLASSES)
    told = {
        "ours: mean probability of the camera": of_activity(seen.test, sequences, seen.leaning.sigmoid()),
        "published: share of camera": theirs / torch.bincount(published.label, minlength=CLASSES),
    }
    _bars(axes, told, (POSTERIOR, PRIOR))
    axes.set_ylabel("camera at lambda = .2")
    return figure


def figure_3_7(found: Mapping[str, Seen], published: Mapping[float, PolicyRun]) -> Figure:
    """Accuracy, charge of an hour and use of the camera over lambda."""
    figure, panels = _panels(1, 3, (11.0, 3.4))
    lines = {
        name: [(trade, *outcome(seen.test, camera)) for trade, camera in seen.chosen["actor-critic"].items()]
        for name, seen in found.items()
    }
    lines["published"] = [
        (trade, float(run.action.float().mean()), float((run.said == run.label).float().mean()))
        for trade, run in sorted(published.items())
    ]
    for (name, points), colour in zip(lines.items(), (POSTERIOR, TRUTH, PRIOR), strict=True):
        trade, use, accuracy = (np.array(column) for column in zip(*points, strict=True))
        for axes, values in zip(panels, (accuracy, MOTION_MAH + CAMERA_MAH * use, use), strict=True):
            axes.plot(trade, values, marker="o", markersize=4, color=colour, label=name)
    for axes, label in zip(panels, ("accuracy", "charge of an hour [mAh]", "share of camera"), strict=True):
        axes.set(xlabel="lambda", ylabel=label)
    panels[0].legend(frameon=False, fontsize=8)
    return figure


def _panels(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False).flatten().tolist()


def _bars(axes: Axes, told: Mapping[str, Tensor], colours: Sequence[str]) -> None:
    """Groups of bars, one group an activity."""
    width, place = 0.8 / len(told), np.arange(CLASSES)
    for k, ((name, values), colour) in enumerate(zip(told.items(), colours, strict=True)):
        axes.bar(place + (k - (len(told) - 1) / 2) * width, values.numpy(), width, color=colour, label=name)
    axes.set_xticks(place, NAMES, rotation=45, ha="right", fontsize=8)
    axes.set(ylim=(0, 1.25), yticks=np.linspace(0, 1, 6))
    axes.legend(frameon=False, fontsize=8, ncols=3, loc="upper center")
