"""Both logs along everything that may have changed, the new one with the changes made good that were found so far."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int

from onlinebayes.criticism.checking.held import Held, Scores, columns_of, hold
from onlinebayes.criticism.checking.judging import Found, Reference
from onlinebayes.criticism.checking.what_may_change import MayChange
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.theta import theta_of
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable

NEWTON = 4
"""Steps to the size of a change."""

SETTLED = 0.1
"""Of its sd: a step to the size of a change that is smaller is the last."""


@dataclass(frozen=True, eq=False)
class Applied:
    """A change of a known size, from a stretch on."""

    found: Found
    size: float


@dataclass(frozen=True, eq=False)
class Asked:
    """The question.

    Args:
        changes: what may have changed, the model's parameters first.
        held: the reference.
        old: its scores.
        reference: what these say.
        model: the refined model, as it is integrated.
        windows: of the new logs.
        stretch: of each.
    """

    changes: Sequence[MayChange]
    held: Held
    old: Scores
    reference: Reference
    model: Identifiable
    windows: Windows
    stretch: Int[torch.Tensor, " V"]

    @property
    def room(self) -> tuple[Float[torch.Tensor, " C"], Float[torch.Tensor, " C"]]:
        """Largest changes down and up."""
        down, up = (
            torch.tensor([end - one.value for one, end in zip(self.changes, ends, strict=True)], dtype=torch.float64)
            for ends in ([one.low for one in self.changes], [one.high for one in self.changes])
        )
        return down.clamp_max(0), up.clamp_min(0)

    def left(self, applied: Sequence[Applied]) -> tuple[Scores, Float[torch.Tensor, " V"]]:
        """Scores and squares of the new windows with these changes made good.

        Raises:
            BadInput: the model diverges with them.
        """
        V, C = self.windows.count, len(self.changes)
        scores = Scores(torch.zeros(V, C, dtype=torch.float64), torch.zeros(V, C, C, dtype=torch.float64))
        squares = torch.zeros(V, dtype=torch.float64)
        for active, mine in self._groups(applied):
            held = self.with_changes(active, mine)
            here = Scores.of(held, self._columns(held))
            scores.u[mine], scores.J[mine], squares[mine] = here.u, here.J, held.squares
        return scores, squares

    def grown(self, applied: Sequence[Applied], which: int) -> float:
        """The size of one of them by Newton's steps, the replay taken anew; as it was where one diverges."""
        one, others = applied[which], [*applied[:which], *applied[which + 1 :]]
        what, size = self.changes[one.found.change], one.size
        mean = float(self.reference.mean[one.found.change])
        for _ in range(NEWTON):
            score = information = 0.0
            try:
                for active, mine in self._groups([*others, Applied(one.found, size)]):
                    if one.found not in [each.found for each in active]:
                        continue
                    held = self.with_changes(active, mine)
                    column = held.rows.columns[..., held.simulator.parameters.index(what.key)]
                    score += float((column * held.rows.residual).sum())
                    information += float(column.square().sum())
            except BadInput:
                return one.size
            moved = size + score / max(information, 1e-300) - mean
            moved = min(max(moved, what.low - what.value), what.high - what.value)
            if abs(moved - size) < SETTLED * one.found.sd:
                return moved
            size = moved
        return size

    def with_changes(self, active: Sequence[Applied], mine: Bool[torch.Tensor, " V"]) -> Held:
        """Some of the new windows, held against the model with changes."""
        simulator = self.model
        values = {one.key: one.value for one in self.changes if one.addition is None}
        for each in active:
            what = self.changes[each.found.change]
            if what.addition is not None:
                simulator = what.addition.joined(simulator, self.windows.runs)
            values[what.key] = what.value + each.size
        theta = theta_of(simulator, values)
        return hold(simulator, self.windows.select(mine.nonzero()[:, 0]), theta, self.held.rows.weight)

    def _groups(self, applied: Sequence[Applied]) -> list[tuple[list[Applied], Bool[torch.Tensor, " V"]]]:
        """Sets of changes, and the windows in which each set holds."""
        ends = sorted({0, *(each.found.stretch for each in applied), int(self.stretch.max()) + 1})
        found = []
        for first, last in itertools.pairwise(ends):
            active = [each for each in applied if each.found.stretch <= first]
            found.append((active, (self.stretch >= first) & (self.stretch < last)))
        return found

    def _columns(self, held: Held) -> Float[torch.Tensor, "W m C"]:
        """Columns of all changes at a model that has some of them."""
        own = {name: k for k, name in enumerate(held.simulator.parameters)}
        additions = [one.addition for one in self.changes if one.addition is not None and one.key not in own]
        moved, kept = columns_of(held, additions)
        place = {id(addition): k for k, addition in enumerate(kept)}
        found = []
        for one in self.changes:
            if one.key in own:
                found.append(held.rows.columns[..., own[one.key]])
            elif id(one.addition) in place:
                found.append(moved[..., place[id(one.addition)]])
            else:  # it cannot be replayed beside what changed
                found.append(torch.zeros_like(held.rows.residual))
        return torch.stack(found, -1)
