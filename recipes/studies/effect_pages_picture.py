"""The fingerprint of an effect: what a model that lacks it still gets wrong after a refit, and which force is missing.

    residual        measured - simulated angle, each window from its fitted start
    missing torque  I (dv/dt measured - dv/dt simulated from the measured q, v, u),     I = 1 / (d(dv/dt) / du)

The second is taken from the readings without their noise, by central differences; the points stand over velocity,
angle and command, blue while the machine moves forward, orange while it moves backward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.identification import Fitted, Windows, fit, replay, signal_rms, weighed_by_noise
from onlinebayes.report import Curve, Panel, chart, stylesheet
from onlinebayes.simulators.identifiable import Identifiable
from recipes.studies.effect_pages_machine import NOISE, STEP, Recording

Array = NDArray[np.float64]

SHOWN_RUNS, SHOWN_EVERY = 3, 12
NUDGE = 0.1  # [N m]
Y_LABEL = "missing torque [N m]"
WIDTH, TALL, LOW = 880, 178, 236


@dataclass(frozen=True)
class Fingerprint:
    """Residual that is left of an effect, with the motion beside it.

    Args:
        left: RMS of the residual over its noise, of bins, starts free.
        time, residual: of the first run [s], [rad]; nan between windows.
        velocity, angle, command, torque: at K instants [rad/s], [rad], [N m], [N m].
    """

    left: float
    time: Array
    residual: Array
    velocity: Array
    angle: Array
    command: Array
    torque: Array


def fingerprint(simulator: Identifiable, windows: Windows, recording: Recording) -> Fingerprint:
    """Refit ``simulator``, which lacks the effect, to a recording with it."""
    fitted = fit(simulator, windows, simulator.nominal)
    time, residual = _residual(fitted, windows)
    velocity, angle, command, torque = _missing(fitted, recording)
    return Fingerprint(
        float(signal_rms(weighed_by_noise(fitted, windows).projected)), time, residual, velocity, angle, command, torque
    )


def draw(found: Fingerprint, title: str) -> str:
    """The picture as an SVG file that follows light and dark."""
    panel = Panel([Curve(found.time, 1e3 * found.residual, "before", "residual")], "residual [mrad]", 136, 1e3 * NOISE)
    parts = [_place(chart([panel], "time [s]", width=WIDTH, title="residual over time"), 0, 0, WIDTH, TALL)]
    across = WIDTH // 3
    for k, (x, name) in enumerate(
        ((found.velocity, "velocity [rad/s]"), (found.angle, "angle [rad]"), (found.command, "command [N m]"))
    ):
        curves = [
            Curve(x[way], found.torque[way], kind, label, dots=True)
            for way, kind, label in (
                (found.velocity <= 0, "before", "moving backward"),
                (found.velocity > 0, "after", "moving forward"),
            )
        ]
        small = chart(
            [Panel(curves, Y_LABEL if k == 0 else "", LOW - 42)], name, width=across, title=f"{Y_LABEL} over {name}"
        )
        parts.append(_place(small, k * across, TALL + 8, across, LOW))
    return _file("".join(parts), TALL + 8 + LOW, title)


def _residual(fitted: Fitted, windows: Windows) -> tuple[Array, Array]:
    signals, _ = replay(fitted.simulator, windows, fitted.theta[None], fitted.lin.starts[None])
    wrong = (windows.value - signals[0])[..., 0].masked_fill(~windows.observed[..., 0], float("nan"))
    mine = torch.nonzero(windows.run == 0).flatten()
    mine = mine[windows.first[mine].argsort()]
    rows = windows.first[mine, None] + torch.arange(1, windows.rows + 1)
    time = windows.step * rows.to(wrong)
    broken = torch.nn.functional.pad(wrong[mine], (0, 1), value=float("nan")).flatten()
    return torch.nn.functional.pad(time, (0, 1), value=float("nan")).flatten().numpy(), broken.numpy()


def _missing(fitted: Fitted, recording: Recording) -> tuple[Array, Array, Array, Array]:
    q, u = recording.exact[:SHOWN_RUNS], recording.command[:SHOWN_RUNS]
    v = (q[:, 2:] - q[:, :-2]) / (2 * STEP)
    a = (v[:, 1:] - v[:, :-1]) / STEP
    # These differences hold a staircase of commands with the weights 1/4, 1/2, 1/4.
    u = (u[:, 1:-2] + 2 * u[:, 2:-1] + u[:, 3:]) / 4
    q, v, a, u = (rows[:, ::SHOWN_EVERY].flatten() for rows in (q[:, 1:-2], v[:, :-1], a, u))
    simulated, pushed = _acceleration(fitted, q, v, u), _acceleration(fitted, q, v, u + NUDGE)
    torque = NUDGE * (a - simulated) / (pushed - simulated)
    return v.numpy(), q.numpy(), u.numpy(), torque.numpy()


def _acceleration(
    fitted: Fitted, q: Float[Tensor, " K"], v: Float[Tensor, " K"], u: Float[Tensor, " K"]
) -> Float[Tensor, " K"]:
    """Mean over one time step [rad/s2]."""
    state = TensorDict({"qpos": q[:, None], "qvel": v[:, None]}, [len(q)])
    inputs = TensorDict({"command": u[:, None, None]}, [len(q), 1])
    after = fitted.simulator.rollout(fitted.theta.expand(len(q), -1), state, inputs, q.new_tensor([STEP]))
    return (after["qvel"][:, 0, 0] - v) / STEP


def _place(drawing: str, x: int, y: int, width: int, height: int) -> str:
    return f'<svg x="{x}" y="{y}" width="{width}" height="{height}">{drawing}</svg>'


def _file(drawing: str, height: int, title: str) -> str:
    """A file of its own: the report's colours and rules for charts, on its paper."""
    style = stylesheet()
    colours, rules = style.split("\n* {")[0], style.splitlines()
    kept = "\n".join([colours, *(rule for rule in rules if rule.startswith((".chart ", ".curve", ".dots")))])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" aria-labelledby="title">'
        f'<title id="title">{title}</title><style>\n{kept}\n.paper {{ fill: var(--paper); }}\n</style>'
        f'<rect class="paper" width="{WIDTH}" height="{height}"/>{drawing}</svg>\n'
    )
