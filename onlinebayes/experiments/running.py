"""An experiment as one run in a folder of its own: begun or gone on with, watched, judged at its end.

    sys.exit(main("pendulum", build, __doc__))      # build(settings) -> Run

The folder's ``run.json`` keeps the settings of the run and those of its objective; the run goes on only with the same.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from onlinebayes.experiments.baselines import baselines
from onlinebayes.experiments.command import STOPPED, status
from onlinebayes.experiments.composition import Run
from onlinebayes.experiments.places import closing_line, place_of
from onlinebayes.experiments.seeds import seeds_of, write_seeds
from onlinebayes.experiments.settings import Settings, recorded_settings
from onlinebayes.experiments.truth import chosen_values
from onlinebayes.loggers import loggers_of
from onlinebayes.objectives import settings_of
from onlinebayes.runs import BadInput, RunFolder, seed_everything, write_atomic
from onlinebayes.trainers import OnlineState, PolicyFiles, Recording, run_in_folder

S = TypeVar("S", bound=Settings)


def main(name: str, build: Callable[[S], Run[Any]], description: str | None, settings: type[S] | None = None) -> int:
    """An experiment as a command: settings from the command line, one run in a folder of its own.

    Args:
        name: of the experiment; its folders are called after it.
        build: settings -> what is run.
        description: shown by ``--help``.
        settings: dataclass of what the command line is read into; :class:`Settings` without it.

    Returns:
        The exit status, as :func:`~onlinebayes.experiments.status` says.
    """
    return status(partial(run, name, build), settings if settings is not None else Settings, description)


def run(name: str, build: Callable[[S], Run[Any]], settings: S) -> int:
    """One run in the folder that :func:`~onlinebayes.experiments.place_of` names.

    Returns:
        0 when it does what it promises (a belief better than the prior, or a better policy), 1 when it does not, 130
        when it was stopped; the same call goes on from there.

    Raises:
        BadInput: the folder holds a run with other settings, or workers are asked of a run that has none.
    """
    if settings.seeds:
        return each_seed(name, build, settings)
    seed_everything(settings.seed)
    settings.workers()  # which refuses before there is a folder, as does
    loggers_of(settings.logger)
    with closing(built(build, settings)) as made:
        return in_folder(name, made, settings)


def each_seed(name: str, build: Callable[[S], Run[Any]], settings: S) -> int:
    """A run for each seed in one folder, with a page of all; returns 0 where every run does what it promises.

    Raises:
        BadInput: seeds that cannot be read, or a seed beside them; and as :func:`run`.
    """
    if settings.seed:
        raise BadInput(f"--seed {settings.seed} beside --seeds {settings.seeds}", "give one of them")
    place, seeds, code, folders = place_of(name, settings), seeds_of(settings.seeds), 0, dict[int, Path]()
    for k, seed in enumerate(seeds):
        print(f"seed {seed}, run {k + 1} of {len(seeds)}", flush=True)
        one = replace(settings, seed=seed, seeds="", out=str(place))
        code = max(code, run(name, build, one))
        if code == STOPPED:
            return STOPPED
        folders[seed] = place_of(name, one)
        said = write_seeds(place, name, folders)
    print(said)
    print(closing_line(place))
    return code


def in_folder(name: str, made: Run[Any], settings: Settings) -> int:
    """The run of what was built; returns as :func:`run`."""
    place, objective = place_of(name, settings), settings_of(made.trainer.objective)
    with RunFolder(place, name, settings=recorded_settings(settings), objective=objective) as folder:
        kinds, infers = baselines(name, settings), made.trainer.schedule.order != "policy-only"
        prior, seen, loggers = made.problem.prior, made.seen_by(), loggers_of(settings.logger)
        with Recording(place, name, prior, seen, made.truth, kinds, infers, loggers=loggers) as recording:
            files = PolicyFiles(place, name, made.trainer.objective, made.problem, settings.worlds_in_words())
            watchers = (recording, files)
            state = run_in_folder(made.trainer, prior, folder, judge=made.judge, watchers=watchers)
        if state.interrupted:
            print(f"stopped; kept: {state.kept()}. The same command goes on from there")
            return STOPPED
        write_atomic(folder.path("finished"), "")
    good = outcome(made, state)
    print(closing_line(place))
    return good


def built(build: Callable[[S], Run[Any]], settings: S) -> Run[Any]:
    """The run.

    Raises:
        BadInput: Ray, a truth or settings are asked of an experiment that does without.
    """
    made = build(settings)
    chosen = chosen_values(made.problem.prior.space, settings.truth)
    if any(float(made.truth[made.problem.prior.space.names.index(name)]) != value for name, value in chosen.items()):
        raise BadInput("the hidden system of this experiment is its own", "leave out --truth")
    learns_by = getattr(made.trainer.objective, "settings", None)
    if settings.set and (learns_by is None or settings.learning(learns_by) != learns_by):
        raise BadInput("this experiment takes no settings of what learns", "leave out --set")
    if settings.ray_workers and made.workers is None:
        raise BadInput("this experiment steps its worlds in one process", "leave out --ray-workers")
    return made


def outcome(made: Run[Any], state: OnlineState) -> int:
    """0 when the run does what it promises: a belief better than the prior where there is one, or a better policy."""
    if made.to_beat is not None:
        after = state.records[-1].figures["return"]
        print(f"return: {made.to_beat:.1f} before, {after:.1f} after")
        return 0 if after > made.to_beat else 1
    if made.trainer.worlds is not None:
        return 0
    gain = float(state.belief.log_prob(made.truth) - made.problem.prior.log_prob(made.truth))
    print(f"the belief holds the truth {abs(gain):.1f} nats {'better' if gain > 0 else 'worse'} than the prior")
    return 0 if gain > 0 else 1
