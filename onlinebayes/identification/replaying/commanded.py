"""Parts of the state at the windows' starts that commands alone decide (MuJoCo: activations), no physics simulated.

    run r, theta_m:   commands since its first row -> a at all its rows  -> picked at each window's first row (M, W)

Along the whole run where that is at hand, else along the history before each window. See
``Identifiable.command_driven_states``.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.simulators.abilities import Remembering

CHUNK = 6_000_000  # numbers that the commands of one call may take


def commanded(
    simulator: Remembering, windows: Windows, theta: Float[Tensor, "M W P"], before: int = 0
) -> dict[str, Tensor]:
    """Key of the state -> its value ``before`` rows before each window's start (M * W, n)."""
    command, mine, last = _by_run(windows) if windows.run_histories else _by_window(windows)
    row = (last - before).clamp_min(0)
    M, (R, K, U) = len(theta), command.shape
    # Windows of one line share their theta.
    window = torch.stack([(mine == r).nonzero()[0, 0] for r in range(R)])
    size, parts = max(1, CHUNK // max(1, R * K * U)), []
    for k in range(0, M, size):
        worlds = theta[k : k + size, window]
        lines = simulator.command_driven_states(worlds.flatten(0, 1), command.repeat(len(worlds), 1, 1), windows.step)
        parts.append({key: line.unflatten(0, (len(worlds), R))[:, mine, row] for key, line in lines.items()})
    return {key: torch.cat([part[key] for part in parts]).flatten(0, 1) for key in parts[0]} if parts else {}


Lines = tuple[Float[Tensor, "R K U"], Int[Tensor, " W"], Int[Tensor, " W"]]


def _by_run(windows: Windows) -> Lines:
    """Commands of the runs up to their last windows, each window's line, and the row at which it starts."""
    runs, mine = torch.unique(windows.run, return_inverse=True)
    row = torch.arange(max(1, int(windows.first.max())), device=windows.run.device)
    lines = [windows.run_histories[r].command for r in runs.tolist()]
    # Rows after a run's end are never picked.
    return torch.stack([line[row.clamp_max(len(line) - 1)] for line in lines]), mine, windows.first


def _by_window(windows: Windows) -> Lines:
    """The same of the history before each window, from the run's first row where that lies in it."""
    Q, window = windows.history.shape[1], torch.arange(windows.count, device=windows.run.device)
    last = windows.first.clamp_max(Q)
    # One row more, of the window itself: all there is without a history.
    line = torch.cat([windows.history, windows.command[:, :1]], dim=1)
    row = (Q - last[:, None] + torch.arange(Q + 1, device=last.device)).clamp_max(Q)
    return line[window[:, None], row], window, last
