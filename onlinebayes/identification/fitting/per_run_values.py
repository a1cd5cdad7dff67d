"""Parameters with one value per run: cross-fitted, so that no value is judged on the rows it was estimated from.

A run that is held out has parameters of its own that nothing else tells. They are nuisances as its windows' starts are,
but one for many windows, so that fitting them to the rows they are judged on would flatter the model. The run is cut
into two halves, and each half is judged with the value that the other half gives, all shared parameters as fitted.
Where there is no other half (a single window) the mean of the fitted runs' values stands in.

The interval of an own value comes from the spread between its run's windows (sandwich, Liang and Zeger 1986):

    V = n / (n - 1) N^-1 (sum_w g_w g_w') N^-1,     N = sum_w C~_w' C~_w,    g_w = C~_w' r~_w

and, where that is small by chance (two windows give it one degree of freedom), from what all windows say of the error,

    kappa N^-1,     kappa = sum_w g_w' (C~_w' C~_w)^-1 g_w / (sum_w rank C~_w - number of own values)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.blocks import FEWEST_BLOCKS, Blocks
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.identification.scope import Scope
from onlinebayes.identification.splitting import HALVES
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable


def run_halves(windows: Windows) -> Int[Tensor, " W"]:
    """0 in the first half of each run's windows, 1 in the second."""
    half = torch.zeros_like(windows.run)
    for run in torch.unique(windows.run):
        mine = (windows.run == run).nonzero()[:, 0]
        half[mine[(len(mine) + 1) // 2 :]] = 1
    return half


def own_covariance(fitted: Fit, blocks: Blocks, across: Float[Tensor, "F F"]) -> Float[Tensor, "F F"]:
    """Return the covariance that the jackknife over blocks misses [SI]: that of own values known from few blocks.

    The jackknife's variance from one block is nothing, and from fewer than seven it is small by chance now and then.
    The largest of three holds: the jackknife's, V, and kappa N^-1. A run of a single window has no spread to go by: its
    sd is the bounds' width / sqrt(12).

    Args:
        fitted: the fit.
        blocks: of its windows.
        across: the jackknife's covariance.
    """
    simulator, F = fitted.simulator, len(fitted.theta)
    covariance = torch.zeros(F, F).to(fitted.theta)
    if not isinstance(simulator, ScopedSimulator):
        return covariance
    width = (simulator.parameters.high - simulator.parameters.low).to(fitted.theta)
    entries = [(simulator.own == who).nonzero()[:, 0] for who in range(len(simulator.owners))]
    parts = [_own_part(fitted, mine) for mine in entries if len(mine)]  # of a run, all may be known
    kappa = _kappa(parts)
    for mine, rows, g, normal in parts:
        held, n = len(torch.unique(blocks.of[rows])), len(g)
        if held >= FEWEST_BLOCKS:
            continue
        if n < 2:
            covariance[mine, mine] = width[mine].square() / 12
            continue
        inverse = torch.linalg.pinv(normal.sum(0), hermitian=True)
        between = n / (n - 1) * inverse @ (g.T @ g) @ inverse
        before = across[mine[:, None], mine]
        added = between if held == 1 else _more(between, before)
        covariance[mine[:, None], mine] = added + _more(kappa * inverse, before + added)
    return covariance


Part = tuple[Int[Tensor, " M"], Bool[Tensor, " W"], Float[Tensor, "n M"], Float[Tensor, "n M M"]]
"""An owner's entries of phi, the windows that tell something of them, and g_w and C~_w' C~_w there."""


def _own_part(fitted: Fit, mine: Int[Tensor, " M"]) -> Part:
    rows = _informs(fitted)[:, mine].any(1)
    c, r = fitted.projected.columns[rows][..., mine], fitted.projected.residual[rows]
    return mine, rows, (c.mT @ r[..., None])[..., 0], c.mT @ c


def _kappa(parts: Sequence[Part]) -> float:
    """Kappa; 0 where no owner has windows to spare."""
    squares, freedom = 0.0, 0
    for mine, _, g, normal in parts:
        if len(g) > 1:
            squares += float((g[:, None] @ torch.linalg.pinv(normal, hermitian=True) @ g[..., None]).sum())
            freedom += int(torch.linalg.matrix_rank(normal, hermitian=True).sum()) - len(mine)
    return squares / freedom if freedom > 0 else 0.0


def _more(wanted: Float[Tensor, "M M"], have: Float[Tensor, "M M"]) -> Float[Tensor, "M M"]:
    """By how much the wanted variances exceed those that are there."""
    return (wanted - have).diagonal().clamp_min(0).diag()


def held_out_model(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, " F"]
) -> tuple[Identifiable, Windows, Float[Tensor, " G"]]:
    """Build the model that replays held-out windows: itself, or one in which half a run has the other half's own value.

    Args:
        simulator, theta: the fitted model.
        windows: of the held-out runs.

    Returns:
        Simulator, windows and theta to replay; the windows are the given ones in the given order, named after the half
        whose own values they take.
    """
    if not isinstance(simulator, ScopedSimulator) or not any(map(simulator.free_in, windows.runs)):
        return simulator, windows, theta
    half = run_halves(windows)
    names = tuple(run + suffix for run in windows.runs for suffix in HALVES)
    begin = tuple(instant for instant in windows.begin for _ in HALVES)
    histories = tuple(one for one in windows.run_histories for _ in HALVES)
    parts = replace(windows, run=2 * windows.run + half, runs=names, begin=begin, run_histories=histories)
    model, start = _parts_model(simulator, parts, theta)
    try:
        found = fit(model, parts, start).theta
    except BadInput:  # it diverges at the other runs' mean: that is what is left to report
        found = start.clone()
    swapped = replace(parts, run=2 * windows.run + 1 - half)
    alone = [name for k, name in enumerate(names) if not bool((parts.run == k).any())]
    for name in alone:  # a half without windows tells nothing: the fitted runs' mean
        mine = model.own == model.owners.index(name)
        found[mine] = start[mine]
    return model, swapped, found


def _parts_model(
    simulator: ScopedSimulator, parts: Windows, theta: Float[Tensor, " F"]
) -> tuple[ScopedSimulator, Float[Tensor, " G"]]:
    """The model in which all is known but the own values of parts of runs, and where those begin."""
    own = Scope(simulator.scope.own)
    known: dict[str, dict[str, float]] = {}
    begin: dict[str, float] = {}
    for name in parts.runs:
        A, c = simulator.affine(name)
        values = dict(zip(simulator.physics.parameters, (A.to(theta) @ theta + c.to(theta)).tolist(), strict=True))
        free = simulator.free_in(name)
        known[name] = {address: value for address, value in values.items() if address not in free}
        begin |= {own.entry(address, name): values[address] for address in free}
    model = ScopedSimulator(simulator.physics, replace(own, known=known), parts.runs)
    return model, theta.new_tensor([begin[name] for name in model.parameters])


def _informs(fitted: Fit) -> Bool[Tensor, "W F"]:
    """Return a mask of the windows that say something about each parameter."""
    return fitted.projected.columns.square().sum(1) > 0
