"""A parameter that changes in time, looked for where no effect and no change between runs was found.

Each free parameter is tried with a ``parameter_drift`` and a ``parameter_step``. With a number for every instant they
find something in whatever another law leaves; therefore they come last, at half the level shared out among the
parameters, and one is believed only where it leaves no more than noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from onlinebayes.criticism.acceptance import Judged, choose
from onlinebayes.criticism.between_runs import HALF_LEVEL, may_change
from onlinebayes.criticism.candidates import propose
from onlinebayes.criticism.numerics import Grounds
from onlinebayes.criticism.projection import project, signal_rms
from onlinebayes.criticism.results import Selection
from onlinebayes.criticism.stage import Stage, run_stage
from onlinebayes.simulators.effects import Effect, ParameterDrift, ParameterStep


def candidates_in_time(current: Grounds) -> tuple[Effect, ...]:
    """A drift and a step of every free parameter that is no effect's and no constant of nature."""
    simulator, windows = current.fitted.simulator, current.windows
    free = [name for name in simulator.targets("parameter") if may_change(name) and name in simulator.parameters]
    return propose(
        simulator, windows, [f"{kind.name}@{name}" for kind in (ParameterDrift, ParameterStep) for name in free]
    )


def changed_in_time(
    current: Grounds, effects: Sequence[Effect], selection: Selection, say: Callable[[str], None]
) -> list[tuple[Stage, Judged]]:
    """The change in time that leaves noise, with the round that found it; empty without any.

    Args:
        current: the model as it stands.
        effects: of :func:`candidates_in_time`.
        selection: how effects are judged.
        say: takes one line of progress.
    """
    parameters = dict.fromkeys(effect.target for effect in effects)
    stricter = replace(selection, alpha=HALF_LEVEL * selection.alpha / max(len(parameters), 1))
    found: list[tuple[Stage, Judged]] = []
    for name in parameters:  # a step may be at any of many instants: all parameters at once would fill the memory
        say(f"looking for changes of {name} in time")
        mine = [effect for effect in effects if effect.target == name]
        stage = run_stage(current.fitted, current.windows, mine, current.numerics, stricter, say, thorough=False)
        quiet = [one for one in stage.judged if one.admissible and _noise(one, current, selection.tolerance)]
        if quiet:
            found.append((stage, choose(quiet, current.windows.bin_step)))
    return [max(found, key=lambda one: one[1].gain.gain)] if found else []


def _noise(judged: Judged, current: Grounds, tolerance: float) -> bool:
    return float(signal_rms(project(current.windows, judged.fitted.lin)).max()) <= tolerance
