"""Figures 5.4 to 5.6 of the thesis: the robot, its paths and cumulative costs, and the two posteriors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from tensordict import TensorDict
from torch import Tensor

from envs.skid_steer import CircleTask, SkidSteerKinematics
from onlinebayes.inference import BoxUniform, plots, saving
from onlinebayes.simulators.drawing import OBLIQUE, render, scene, view_of
from recipes.skid_steer import SPACE

COLOURS = {"prior": "0.6", "first posterior": "tab:orange", "second posterior": "tab:blue", "truth": "k"}


def draw(case: Mapping[str, Any], truth: Tensor, folder: Path) -> None:
    """Write the three pictures of one case."""
    plots.save(drives(case, truth), folder / "figure-5.4.png", dpi=110)
    for number, name in ((5, "first posterior"), (6, "second posterior")):
        belief = saving.load(case[name]["file"], SPACE)
        figure = plots.corner(belief, truth=truth, prior=BoxUniform(SPACE), title=f"skid-steer, {name}")
        plots.save(figure, folder / f"figure-5.{number}.png", dpi=110)
    print(f"written: {folder}/figure-5.4.png to figure-5.6.png")


def drives(case: Mapping[str, Any], truth: Tensor) -> Figure:
    """Figure 5.4: the robot, a path and the cumulative average of the cost for each belief."""
    figure = Figure(figsize=(13, 4), layout="constrained")
    robot, path, cost = figure.subplots(1, 3)
    robot.imshow(picture(truth))
    robot.set_axis_off()
    robot.set_title("the robot; red: its centre of rotation")
    angle = np.linspace(0, 2 * math.pi, 200)
    path.plot(np.cos(angle), np.sin(angle), color="0.85", linewidth=6)
    for name, colour in COLOURS.items():
        places, steps = np.array(case[name]["path"]), np.arange(1, len(case[name]["curve"]) + 1)
        path.plot(*places.T, color=colour, label=name)
        cost.plot(0.1 * steps, np.cumsum(case[name]["curve"]) / steps, color=colour, label=name)
    path.set(xlabel="x [m]", ylabel="y [m]", title="one drive of 20 s", aspect="equal")
    cost.set(xlabel="time [s]", ylabel="average cost so far", yscale="log", title="mean of three drives")
    cost.legend()
    return figure


def picture(truth: Tensor) -> np.ndarray:
    """The robot on its circle."""
    simulator, task = SkidSteerKinematics(SPACE), CircleTask()
    states = TensorDict({"qpos": torch.tensor([[0.0, -1.0, 0.3]], dtype=torch.float64)}, [1])
    shapes, poses = scene([simulator, task], truth, states)
    only, where = scene([simulator], truth, states)
    view = view_of(only, where, OBLIQUE)
    return render(shapes, poses[0], size=(360, 480), view=view)
