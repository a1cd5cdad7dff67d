"""The predicted gain of each candidate, without a refit: one replay a starting value, the rest least squares.

    c~ = the replay with the candidate, minus the one without, starts taken out
    (d, a) = argmin |r~ - C~ d - c~ a|^2      within the bounds of theta and of the candidate's size a

The same least squares without each fold in turn predicts that fold, so that the prediction is the gain of
:mod:`.judging.scoring` to first order. It chooses what is refitted, and decides nothing. Where there are many
candidates, all are looked at in the quarter of the windows that errs most first, where nothing is left out, and those
that promise most in all of them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.gauss_newton import Fitted, score_of
from onlinebayes.identification.fitting.rows import rms, taken_out
from onlinebayes.identification.fitting.theta import theta_of, values_of
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator
from onlinebayes.identification.judging.hypothesis import Addition, Start
from onlinebayes.identification.judging.rule import LEAST_GAIN
from onlinebayes.identification.judging.scoring import Folds, LinearModel, left_out
from onlinebayes.identification.replaying.extrapolated import in_one_step
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.runs import BadInput, Kept, Stopped, remembered, side_by_side
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

FEW = 8
"""Windows at least, and a quarter of all, that show which candidates promise most: those that err most."""

SHORTLIST = 12
"""Candidates that are looked at in all windows: four times as many as are refitted."""

STARTS = 3
"""Starting values of a candidate from which a refit may begin, those that promise most."""

CONFOUNDED = 1e-3
"""Share of its square of which nothing but this is left: then the free parameters do the same already."""

SILENT = 1e-3
"""Of what is left, by which a candidate moves the rows at most, whatever its size: it moves nothing."""

PART = 0.03
"""Of a candidate's norm, from which on a parameter is named as one that does the same."""

SAME_LAW = 0.995
"""Cosine between what two candidates do: at that angle, a fit to one leaves a hundredth of the other's square."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """The best starting value of one candidate, and what it promises.

    Args:
        addition: the candidate.
        begun: where a refit may begin, entry -> value [SI]: the best starting values, as predicted and as they are.
        gain: predicted gain in left-out score [nats].
        direction: how it moves the rows, starts and theta taken out, of norm 1.
        imitated_by: free parameters that do the same already; empty where they cannot.
        visible: the smallest size that would have been seen, as a distance from neutral [SI of its first parameter];
            infinite where none would.
    """

    addition: Addition
    begun: tuple[Mapping[str, float], ...]
    gain: float
    direction: Float[Tensor, " N"]
    imitated_by: tuple[str, ...] = ()
    visible: float = math.inf

    def alike(self, other: Prediction) -> bool:
        """Check whether it is the same law as another, to first order; both were looked at in all windows."""
        return self.direction.shape == other.direction.shape and abs(float(self.direction @ other.direction)) > SAME_LAW


@dataclass(frozen=True)
class _Screen:
    """The fitted model, and the windows in which candidates are tried.

    Args:
        fitted, windows: the model without them.
        rough: the same, integrated as cheaply as it runs.
        base: its replay [SI].
        folds: of the windows; None to leave nothing out.
    """

    fitted: Fitted
    rough: Identifiable
    windows: Windows
    base: Float[Tensor, "W n S"]
    folds: Folds | None

    def of_part(self) -> _Screen:
        """The quarter of the windows that err most, nothing left out."""
        few = min(self.windows.count, max(FEW, self.windows.count // 4))
        some = self.fitted.rows.residual.square().sum(1).topk(few).indices.sort().values
        return _Screen(self.fitted.of(some), self.rough, self.windows.select(some), self.base[some], None)

    @cached_property
    def model(self) -> LinearModel:
        """To first order."""
        return LinearModel.of(self.fitted)

    @cached_property
    def basis(self) -> Float[Tensor, "N P"]:
        """Orthonormal, of what the parameters do."""
        return orthonormal(self.model.columns.flatten(0, 1))

    @cached_property
    def _now(self) -> float:
        return self._score(self.model)

    def made_ready(self) -> None:
        """Work out once what every candidate is compared with."""
        _ = self.model, self.basis, self._now

    def gain(self, grown: LinearModel) -> float:
        """Of a model with more parameters, to first order."""
        return self._now - self._score(grown)

    def _score(self, model: LinearModel) -> float:
        if self.folds is not None:
            return float(left_out(model, self.windows, self.folds).by_signal.sum())
        left = model.rows.residual - model.columns @ model.whole()
        return score_of(self.windows, model.rows.in_noise(left))


def screen(
    evaluator: Evaluator,
    here: Evaluation,
    candidates: Sequence[Addition],
) -> list[Prediction]:
    """Every candidate's predicted gain, the largest first; candidates that the simulator refuses are left out."""
    fitted, windows, folds = here.fitted, evaluator.windows, evaluator.partitions[0]
    return remembered(
        evaluator.memo,
        ("screen", *evaluator.context, here.hypothesis, fitted.lin, folds, candidates),
        partial(_screen, fitted, windows, folds, candidates),
        _packed,
        partial(_unpacked, {addition.key: addition for addition in candidates}),
    )


def _packed(found: Sequence[Prediction]) -> Kept:
    """For a memo."""
    plain = [{**vars(one), "addition": one.addition.key, "direction": None} for one in found]
    return Kept({str(k): one.direction for k, one in enumerate(found)}, json.dumps(plain, default=dict))


def _unpacked(additions: Mapping[str, Addition], kept: Kept) -> list[Prediction]:
    """Restore the predictions that a memo kept."""
    found = []
    for k, told in enumerate(json.loads(kept.text)):
        told |= {"addition": additions[told["addition"]], "direction": kept.tensors[str(k)]}
        found.append(Prediction(**{**told, "begun": tuple(told["begun"]), "imitated_by": tuple(told["imitated_by"])}))
    return found


def _screen(fitted: Fitted, windows: Windows, folds: Folds, candidates: Sequence[Addition]) -> list[Prediction]:
    # Both in the same cheap way: what it errs by falls out of the difference.
    rough = in_one_step(fitted.rough)
    base, valid = replay_binned(rough, windows, fitted.theta[None], fitted.lin.starts[None])
    if not bool(valid.all()):
        raise BadInput("the fitted model diverges in coarse steps", "give the model a shorter time step")
    bench = _Screen(fitted, rough, windows, base[0], folds)
    if len(candidates) <= SHORTLIST:
        return _ordered(bench, candidates)
    first = _ordered(bench.of_part(), candidates)
    return _ordered(bench, [one.addition for one in first[:SHORTLIST]]) + first[SHORTLIST:]


def _ordered(bench: _Screen, candidates: Sequence[Addition]) -> list[Prediction]:
    bench.made_ready()
    found = side_by_side([partial(_best, bench, addition) for addition in candidates])
    return sorted((one for one in found if one is not None), key=lambda p: -p.gain)


def _best(bench: _Screen, addition: Addition) -> Prediction | None:
    best = sorted(_predictions(bench, addition), key=lambda p: -p.gain)[:STARTS]
    if not best:
        return None
    begun = tuple(values for one in best for values in one.begun)
    return replace(best[0], begun=begun, visible=max(one.visible for one in best))


def _predictions(bench: _Screen, addition: Addition) -> Iterator[Prediction]:
    """One for each starting value at which the replay stays finite."""
    fitted, windows = bench.fitted, bench.windows
    try:
        simulator = addition.joined(bench.rough, windows.runs)
    except Stopped:
        raise
    except BadInput:
        return
    known = values_of(fitted.simulator, fitted.theta)
    starts = addition.starts(simulator, known)
    thetas = torch.stack([theta_of(simulator, {**known, **start.values}) for start in starts])
    begun = fitted.lin.starts.expand(len(thetas), *fitted.lin.starts.shape)
    shown, valid = replay_binned(simulator, windows, thetas, begun)
    moved = torch.where(valid.all(1)[:, None, None, None], shown - bench.base, torch.zeros_like(shown))
    columns = taken_out(windows, fitted.rows, moved.movedim(0, -1))
    for k, start in enumerate(starts):
        column = columns[..., k]
        farthest = max(abs(start.low), abs(start.high))
        if not float(column.norm()) * farthest > SILENT * float(fitted.rows.residual.norm()):
            continue
        grown = bench.model.grown(*_sizes(simulator, windows, column, start))
        sizes = grown.whole()[len(bench.model.low) :].tolist()
        scaled = {name: start.neutral + size * start.reach for name, size in zip(start.sized, sizes, strict=True)}
        left = column.flatten() - bench.basis @ (bench.basis.T @ column.flatten())
        confounded = float(left.square().sum()) < CONFOUNDED * float(column.square().sum())
        predicted = ({**start.values, **scaled},) if any(sizes) else ()  # at size 0 nothing has a slope but the size
        yield Prediction(
            addition,
            # A finite starting value may stand where linear prediction means little: it is tried as it is, too.
            (*predicted, start.values),
            bench.gain(grown),
            left / left.norm().clamp_min(1e-300),
            _imitators(fitted, column) if confounded else (),
            math.inf if confounded else abs(start.reach) * (_seen(bench, left) + max(map(abs, sizes))),
        )


def _seen(bench: _Screen, left: Float[Tensor, " N"]) -> float:
    """The size of a candidate, in units of its reach, that gains the least that the rule asks for in some signal.

    1/2 log((1 + e^2 + a^2 c^2) / (1 + e^2)) = g      with e, c: RMS of what is left and of the candidate, in noise
    """
    windows, rows = bench.windows, bench.fitted.rows
    e, c = (rms(windows, rows.in_noise(one)) for one in (rows.residual, left.view_as(rows.residual)))
    return float(((math.expm1(2 * LEAST_GAIN) * (1 + e.square())).sqrt() / c.clamp_min(1e-300)).min())


def orthonormal(columns: Float[Tensor, "N P"]) -> Float[Tensor, "N Q"]:
    """An orthonormal basis of what the columns span."""
    if not columns.shape[1]:
        return columns
    U, singular, _ = torch.linalg.svd(columns / columns.norm(dim=0).clamp_min(1e-300), full_matrices=False)
    return U[:, singular > 1e-9 * singular.max()]


def _imitators(fitted: Fitted, column: Float[Tensor, "W m"]) -> tuple[str, ...]:
    """The free parameters that together do what a candidate does, the largest first."""
    C, c = fitted.rows.columns.flatten(0, 1), column.flatten()
    parts = (torch.linalg.lstsq(C, c[:, None]).solution[:, 0] * C.norm(dim=0)).abs() / c.norm()
    order = parts.argsort(descending=True).tolist()
    return tuple(fitted.simulator.parameters.names[i] for i in order if float(parts[i]) > PART)


def _sizes(
    simulator: Simulator, windows: Windows, column: Float[Tensor, "W m"], start: Start
) -> tuple[Float[Tensor, "W m K"], Float[Tensor, " K"], Float[Tensor, " K"]]:
    """Columns of a candidate's size, or of one in each run or group of runs, and their bounds."""
    columns = column[..., None]
    if isinstance(simulator, ScopedSimulator) and len(start.sized) > 1:
        own = [simulator.parameters.index(name) for name in start.sized]
        columns = columns * simulator.touches(windows)[own].T.to(column)[:, None, :]
    low, high = (column.new_full((columns.shape[-1],), end) for end in (start.low, start.high))
    return columns, low, high
