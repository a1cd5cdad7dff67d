"""Windows held against a model whose parameters stand: each from its best start, and what each change would do there.

    s_w = argmin |r~_w|^2,     c_i = d r~ / d (size of change i),  starts taken out
    u_wi = c_wi' r~_w,         J_wij = c_wi' c_wj                  score and information of a window

The rows are weighed as the reference asks (:mod:`.fitting.rows`), the new windows with the same weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.rows import Rows, project, rms, start_shift, taken_out
from onlinebayes.identification.fitting.sensitivities import Linearisation, linearise, linearise_starts
from onlinebayes.identification.fitting.theta import theta_of, values_of
from onlinebayes.identification.judging.hypothesis import Addition
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable

STEPS = 20
"""Of the starts at most: where a machine is near an unstable posture they settle slowly."""

SETTLED = 0.99
"""Of a window's squares before a step: where more is left after it, the start has settled."""


@dataclass(frozen=True, eq=False)
class Held:
    """Windows from their best starts.

    Args:
        simulator: the model, as it is integrated.
        windows: the data.
        lin: replay and derivatives.
        rows: the same, starts taken out.
    """

    simulator: Identifiable
    windows: Windows
    lin: Linearisation
    rows: Rows

    @property
    def rms(self) -> Float[Tensor, " S"]:
        """Of every signal [SI]."""
        return rms(self.windows, self.rows.in_noise(self.rows.residual)) * self.windows.noise

    @property
    def squares(self) -> Float[Tensor, " W"]:
        """Sum of squares of every window's rows."""
        return self.rows.residual.square().sum(1)


@dataclass(frozen=True, eq=False)
class Scores:
    """Score and information of C changes in W windows.

    Args:
        u: score.
        J: information.
    """

    u: Float[Tensor, "W C"]
    J: Float[Tensor, "W C C"]

    @classmethod
    def of(cls, held: Held, columns: Float[Tensor, "W m C"]) -> Scores:
        """Of windows along columns."""
        return cls(torch.einsum("wmc,wm->wc", columns, held.rows.residual), columns.mT @ columns)

    def only(self, changes: Sequence[int]) -> Scores:
        """Of some of the changes."""
        return Scores(self.u[:, changes], self.J[:, changes][:, :, changes])


def hold(simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"], weight: Float[Tensor, "n S"]) -> Held:
    """Hold windows against a model.

    Args:
        simulator: as it is integrated.
        windows: the data.
        theta: of the simulator [SI].
        weight: w of the rows.

    Raises:
        BadInput: the replay diverges over them.
    """
    starts = _settled(simulator, windows, theta, weight)
    lin = linearise(simulator, windows, theta, starts)
    if not lin.valid:
        raise _diverges(windows)
    return Held(simulator, windows, lin, project(windows, lin, weight))


def _settled(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"], weight: Float[Tensor, "n S"]
) -> Float[Tensor, "W J2"]:
    """The best start of every window, by Gauss-Newton steps for as long as its squares fall."""
    best, starts, still = windows.start.clone(), windows.start, theta.new_zeros(1, len(theta))
    least, active = torch.full_like(best[:, 0], torch.inf), torch.arange(windows.count)
    for _ in range(STEPS):
        part = windows.select(active)
        lin = linearise_starts(simulator, part, theta, starts)
        if not lin.valid:
            raise _diverges(windows)
        rows = project(part, lin, weight)
        squares = rows.residual.square().sum(1)
        better, going = squares < least[active], squares < SETTLED * least[active]
        best[active[better]], least[active[better]] = starts[better], squares[better]
        if not bool(going.any()):
            break
        starts = (lin.starts + start_shift(part, lin, rows, still)[0])[going]
        active = active[going]
    return best


def _diverges(windows: Windows) -> BadInput:
    runs = ", ".join(windows.runs[:4])
    return BadInput(
        f"the refined model diverges over the runs {runs}", "check units and commands of the log, or refine on it"
    )


def columns_of(held: Held, additions: Sequence[Addition]) -> tuple[Float[Tensor, "W m C"], list[Addition]]:
    """What additions of size one would do to the rows, and those of them that the simulator can carry.

    Args:
        held: the model without them.
        additions: each tried at its smallest step.
    """
    lin, windows, kept, found = held.lin, held.windows, list[Addition](), list[Tensor]()
    base, _ = replay_binned(held.simulator, windows, lin.theta[None], lin.starts[None])
    for addition in additions:
        moved = _moved(held, addition, base[0])
        if moved is not None:
            kept.append(addition)
            found.append(taken_out(windows, held.rows, moved[..., None]))
    empty = held.rows.residual.new_zeros(*held.rows.residual.shape, 0)
    return torch.cat([empty, *found], -1), kept


def _moved(held: Held, addition: Addition, base: Float[Tensor, "W n S"]) -> Float[Tensor, "W n S"] | None:
    """The change of the replay for an addition of size one [1 / its unit]; None where it cannot be replayed."""
    lin, windows = held.lin, held.windows
    known = values_of(held.simulator, lin.theta)
    try:
        simulator = addition.joined(held.simulator, windows.runs)
        start = addition.starts(simulator, known)[0]
        theta = theta_of(simulator, {**known, **start.values})
    except BadInput:
        return None
    shown, valid = replay_binned(simulator, windows, theta[None], lin.starts[None])
    return (shown[0] - base) / start.reach if bool(valid.all()) else None
