"""Where the held-out runs went further than the runs that were fitted, if the model errs far more there.

    error in a held-out run > 2 max(error over the fit runs, noise floor)
    largest command or speed > 1.1 times that of the fit runs;    position outside of theirs by a tenth of its range

A limit, a stop or a force that never acted while the model was fitted is in no fit, and no search can name it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from onlinebayes.identification import quantities
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.heldout import replay_error
from onlinebayes.identification.results import ReplayedRun

CLEARLY = 2.0
"""Times that an error is above another one."""

FURTHER = 0.1
"""Share by which a run goes further than others."""

AT_REST = 10.0
"""A joint whose position has a range of so few floors rests."""

MOST = 3
"""So many things are said of a run."""


@dataclass(frozen=True)
class Reach:
    """How far a run, or several, went: largest |command|, largest |speed| [SI], both ends of each position [SI]."""

    command: Mapping[str, float]
    speed: Mapping[str, float]
    position: Mapping[str, tuple[float, float]]


def reaches(windows: Windows, commands: Sequence[str]) -> dict[str, Reach]:
    """Run -> how far it went, smoothed as measured; runs of which that is not known are left out."""
    found = {}
    for run, past in zip(windows.runs, windows.run_histories, strict=False):
        if past.motion is None:
            continue
        q, v, u = (past.motion[key] for key in ("q", "v", "command"))
        ends = zip(q.amin(0).tolist(), q.amax(0).tolist(), strict=True)
        found[run] = Reach(
            dict(zip(commands, u.abs().amax(0).tolist(), strict=True)),
            dict(zip(past.joints, v.abs().amax(0).tolist(), strict=True)),
            dict(zip(past.joints, ends, strict=True)),
        )
    return found


def new_ground_notes(
    replays: Iterable[ReplayedRun],
    fitted: Mapping[str, Reach],
    held: Mapping[str, Reach],
    floors: Mapping[str, float],
    units: Mapping[str, str],
) -> tuple[str, ...]:
    """A sentence for each held-out run in which the model errs far more and that goes further than the fit runs.

    Args:
        replays: of the final model over all runs, starts as measured.
        fitted, held: run -> how far it went, of the fit runs and of the held-out ones.
        floors: signal -> noise floor of the held-out error [the signal's unit].
        units: signal -> unit.
    """
    replays, names = tuple(replays), tuple(units)
    fit_runs = tuple(run for run in replays if not run.held_out)
    if not fit_runs or not fitted:
        return ()
    usual, seen = replay_error(fit_runs, names), widest_reach(fitted.values())
    notes = []
    for run in replays:
        if not run.held_out or run.run not in held:
            continue
        error = replay_error((run,), names)
        excess = {name: error[name] / max(usual[name], floors[name]) for name in names if usual[name] or floors[name]}
        worst = max(excess, key=lambda name: excess[name] if excess[name] > 0 else 0.0, default=None)
        further = list(beyond(moving(held[run.run], floors), seen, units))
        if worst is None or not excess[worst] > CLEARLY or not further:
            continue
        size = quantities.text(error[worst], units[worst])
        errs = f"errs by {size} in {worst} ({quantities.text(usual[worst], units[worst])} in the fit runs)"
        diverges = f"diverges in {worst}"
        notes.append(
            f"in held-out run “{run.run}” the model {errs if error[worst] < float('inf') else diverges}, and that run "
            f"{' and '.join(further[:MOST])}: what acts or limits there was not seen"
        )
    return tuple(notes)


def moving(run: Reach, floors: Mapping[str, float]) -> Reach:
    """The same without joints that rest: what their sensors' noise does is no motion."""
    moves = {
        joint: ends
        for joint, ends in run.position.items()
        if not ends[1] - ends[0] <= AT_REST * floors.get(f"qpos.{joint}", 0)
    }
    return Reach(run.command, {joint: run.speed[joint] for joint in moves}, moves)


def widest_reach(runs: Iterable[Reach]) -> Reach:
    """How far any of the runs went."""
    runs = tuple(runs)
    return Reach(
        {name: max(run.command[name] for run in runs) for name in runs[0].command},
        {name: max(run.speed[name] for run in runs) for name in runs[0].speed},
        {
            name: (min(run.position[name][0] for run in runs), max(run.position[name][1] for run in runs))
            for name in runs[0].position
        },
    )


def beyond(run: Reach, seen: Reach, units: Mapping[str, str]) -> Iterator[str]:
    """In which a run goes further than all that was fitted, in words; commands first, then speeds, then positions."""
    for name, most in _further(run.command, seen.command):
        # A command's unit is its actuator's own.
        large, usual = (quantities.text(value, "") for value in (most, seen.command[name]))
        yield f"commands {name} up to {large} where the fit runs reach {usual}"
    for joint, most in _further(run.speed, seen.speed):
        unit = units.get(f"qvel.{joint}") or f"{units.get(f'qpos.{joint}') or '1'}/s"
        fast, usual = (quantities.text(value, unit) for value in (most, seen.speed[joint]))
        yield f"moves {joint} at up to {fast} where the fit runs reach {usual}"
    for joint, (low, high) in run.position.items():
        least, most = seen.position[joint]
        margin = FURTHER * (most - least)
        end = high if high > most + margin else low
        if margin > 0 and (high > most + margin or low < least - margin):
            to, one, other = (quantities.text(value, units.get(f"qpos.{joint}", "")) for value in (end, least, most))
            yield f"takes {joint} to {to} where the fit runs stay between {one} and {other}"


def _further(run: Mapping[str, float], seen: Mapping[str, float]) -> list[tuple[str, float]]:
    """What is larger by more than a tenth; of what never was anything else than zero nothing is known either."""
    larger = [(name, value) for name, value in run.items() if value > (1 + FURTHER) * seen[name]]
    return sorted(larger, key=lambda one: -one[1] / max(seen[one[0]], 1e-300))
