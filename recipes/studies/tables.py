"""``make tables``: Table 4.1 of the thesis with our estimators, one round, beside its figures and the prior's.

    x = statistics of Eq 4.20, averaged over ten rollouts of 50 steps,    2000 thetas of ten rollouts each
    figure = log q(true value | x of ten rollouts of the true system)     five seeds, median

An average of ten rollouts is no draw from simulations of one: columns learn from averages of ten. Rejection compares
averages with single rollouts, and is wide for it; the filter reads the ten one by one. CartPole's row for a parameter
has the other one unknown, too. A row's goal is for the best of its columns, as the thesis's figure is the best of its
table; there is no sensor noise, so that a sharper method can have any figure.

    python -m recipes.studies.tables [--systems Pendulum]       -> docs/results/tables.json
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase

from onlinebayes.embeddings import Embedding, PooledEmbedding, StatisticsEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.experiments import status
from onlinebayes.inference import (
    BoxUniform,
    FlowEstimator,
    FourierFeatures,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    PosteriorEstimator,
    RejectionABC,
    fit,
    length_scales,
)
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import ResultTable
from recipes.studies.jobs import Places, each_kept_or_done, finished, printed_by
from recipes.studies.one_round import FEATURES, begun
from recipes.studies.table_systems import SYSTEMS, System

SIMULATIONS, SEEDS = 2000, (541, 542, 543, 544, 545)
TRAIN = partial(fit, epochs=100, batch_size=100, learning_rate=2e-3)
FILTER, FILTER_TRAIN = "filter", partial(fit, epochs=25, batch_size=50, learning_rate=1e-3)
PUBLISHED_SCALE = 5.0
"""Length scale of the published code, for all systems."""

NOT_IN_THE_DYNAMICS, UNKNOWABLE = "Acrobot L2", 0.05
"""Its width is 1, so that the prior's log density is 0, and no estimator can know better."""

Maker = Callable[[ParameterSpace, TensorDictBase], PosteriorEstimator]
"""(the parameter asked for, simulated sets) -> a fresh estimator."""


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    systems: tuple[str, ...] = tuple(SYSTEMS)
    """which rows"""
    seeds: tuple[int, ...] = SEEDS
    """of simulations, networks and true rollouts"""
    out: str = "out/tables"


def features_of(sets: TensorDictBase) -> TransitionFeatures:
    """Features without a simulator."""
    return TransitionFeatures(sets["observation"].shape[-1], sets["action"].shape[-1])


def thesis_statistics(sets: TensorDictBase) -> Embedding:
    """Eq 4.20, averaged over a set."""
    return PooledEmbedding(StatisticsEmbedding(features_of(sets)))


def own_averages(sets: TensorDictBase) -> Embedding:
    """The library's averages, of more products."""
    return PooledEmbedding(SummaryEmbedding(features_of(sets)))


def mixture(
    embed: Callable[[TensorDictBase], Embedding], space: ParameterSpace, sets: TensorDictBase
) -> NeuralEstimator:
    """A mixture density network."""
    embedding = embed(sets)
    network = MixtureEstimator(space, embedding.size)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network, whole_sets=True), TRAIN)


def fourier(space: ParameterSpace, sets: TensorDictBase) -> NeuralEstimator:
    """Fourier features of the Matern 5/2 kernel; their length scale is the median distance between statistics."""
    embedding = thesis_statistics(sets)
    loss = NeuralPosteriorLoss(embedding, MixtureEstimator(space, embedding.size), whole_sets=True)
    (scale,) = length_scales(loss, sets, [1.0])
    trunk = FourierFeatures(embedding.size, FEATURES, length_scale=scale)
    network = MixtureEstimator(space, embedding.size, hidden=FEATURES, trunk=trunk)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network, whole_sets=True), TRAIN)


def published(space: ParameterSpace, sets: TensorDictBase) -> NeuralEstimator:
    """The published code's features and length scale."""
    embedding = thesis_statistics(sets)
    trunk = FourierFeatures(embedding.size, FEATURES, length_scale=PUBLISHED_SCALE, legacy=True)
    network = MixtureEstimator(space, embedding.size, hidden=FEATURES, trunk=trunk, diagonal=True)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network, whole_sets=True), TRAIN)


def flow(kind: str, space: ParameterSpace, sets: TensorDictBase) -> NeuralEstimator:
    """A normalising flow."""
    embedding = thesis_statistics(sets)
    network = FlowEstimator(space, embedding.size, kind=kind)  # type: ignore[arg-type]
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network, whole_sets=True), TRAIN)


def rejection(space: ParameterSpace, sets: TensorDictBase) -> RejectionABC:
    """The nearest single rollouts."""
    return RejectionABC(StatisticsEmbedding(features_of(sets)), space)


COLUMNS: dict[str, Maker] = {
    "mixture": partial(mixture, thesis_statistics),
    "mixture on our averages": partial(mixture, own_averages),
    "Fourier features": fourier,
    "Fourier features as published": published,
    "spline flow": partial(flow, "nsf"),
    "affine flow": partial(flow, "maf"),
    "rejection": rejection,
}


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs = {(name, seed): partial(columns, name, seed) for name in study.systems for seed in study.seeds}
    found = each_kept_or_done("tables", study.out, jobs, file_of, study.ray_workers)
    return finished(tabled(found, study), study.results, found)


def file_of(key: tuple[str, int]) -> str:
    """Name of a job's file."""
    return f"{key[0].replace(' ', '_')}-{key[1]}"


def columns(name: str, seed: int) -> dict[str, Any]:
    """All columns of a system's rows: parameter -> column -> log density of the true value."""
    system, draw = SYSTEMS[name], begun(seed)
    sets = system.simulate(BoxUniform(system.space).sample((SIMULATIONS,), draw), draw)
    true = system.simulate(system.space.vector(system.truth)[None], draw)
    found = {parameter: row(system, parameter, sets, true, draw) for parameter in system.rows}
    if system.filtered is not None:
        for parameter, value in by_filter(system, sets, true, begun(seed)).items():
            found[parameter][FILTER] = value
    return found


def by_filter(system: System, sets: TensorDict, true: TensorDict, generator: torch.Generator) -> dict[str, float]:
    """Parameter -> log density of its true value, the others integrated out, given the ten rollouts one by one."""
    assert system.filtered is not None
    embedding = system.filtered()
    network = MixtureEstimator(system.space, embedding.size, located=True)
    estimator = NeuralEstimator(NeuralPosteriorLoss(embedding, network), FILTER_TRAIN)
    estimator.fit(sets[:, 0], generator=generator)
    posterior = estimator.condition(true[0].exclude("theta"))
    truth = system.space.vector(system.truth)
    found = {}
    for i, name in enumerate(system.space):
        found[name] = float(posterior.marginal([name]).log_prob(truth[i : i + 1]))
    return found


def row(
    system: System, parameter: str, sets: TensorDict, true: TensorDict, generator: torch.Generator
) -> dict[str, float]:
    """One parameter's columns; the others, unknown too, are integrated out by not being asked for."""
    space, index = ParameterSpace({parameter: system.space[parameter]}), list(system.space).index(parameter)
    asked = sets.copy().set("theta", sets["theta"][..., index : index + 1])
    value = space.vector({parameter: system.truth[parameter]})
    found = {}
    for column, make in COLUMNS.items():
        torch.manual_seed(generator.initial_seed())
        estimator = make(space, asked)
        single = isinstance(estimator, RejectionABC)
        estimator.fit(asked[:, 0] if single else asked, generator=generator)
        found[column] = float(estimator.condition(true[0].exclude("theta")).log_prob(value))
    return found


def tabled(found: dict[tuple[str, int], dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all systems."""
    table = ResultTable("tables", printed_by("tables", study), study.seeds)
    for name in study.systems:
        for parameter, (thesis, least) in SYSTEMS[name].rows.items():
            told = name if name.startswith("Acrobot") else f"{name} {parameter}"
            columns = [*COLUMNS, *[FILTER] * (SYSTEMS[name].filtered is not None)]
            of = {c: [found[name, seed][parameter][c] for seed in study.seeds] for c in columns}
            for column, values in of.items():
                table.add_seeds(f"{told}, {column}", values, unit="nats")
            add_goal(table, told, of, least)
            table.add(f"{told}: best of the thesis's", thesis, unit="nats")
            prior = BoxUniform(ParameterSpace({parameter: SYSTEMS[name].space[parameter]}))
            table.add(f"{told}: the prior", float(prior.log_prob(prior.sample((1,)))), unit="nats")
    return table


def add_goal(table: ResultTable, told: str, of: dict[str, list[float]], least: float) -> None:
    """The row's goal: the best column's least; of a parameter that does nothing, the prior's density."""
    if told == NOT_IN_THE_DYNAMICS:
        middle = statistics.median(of["mixture"])
        goal = f"0 within {UNKNOWABLE:g}"
        table.add(f"{told}: the mixture", middle, unit="nats", goal=goal, holds=abs(middle) <= UNKNOWABLE)
        return
    best = max(statistics.median(values) for values in of.values())
    table.add(f"{told}: best of the columns", best, unit="nats", goal=f"at least {least:g}", holds=best >= least)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
