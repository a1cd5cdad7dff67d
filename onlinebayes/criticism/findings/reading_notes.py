"""What was taken where log and model do not say: commands in gaps and before runs, constraints rigid or soft."""

from __future__ import annotations

from onlinebayes.identification.fitting.before_runs import remembers_commands
from onlinebayes.identification.fitting.gaps import rows_missing
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable


def gap_notes(fit_runs: Measurement) -> tuple[str, ...]:
    """How commands were read where the log seems to lack rows; nothing where it lacks none that matter."""
    if not (count := rows_missing(fit_runs)):
        return ()
    held = fit_runs.held_over_gaps
    read = "held until the next row" if held else "taken to go on a straight line to the next row"
    rows = "1 row seems" if count == 1 else f"{count} rows seem"
    return (f"{rows} to be missing in the log; commands are {read}: the model follows the log no better otherwise",)


def tie_notes(simulator: Identifiable, otherwise: Identifiable | None) -> tuple[str, ...]:
    """That constraints are rigid, where they could be soft.

    Args:
        simulator: the base model.
        otherwise: the same with constraints that are soft in place of rigid, or rigid in place of soft.
    """
    if otherwise is None or simulator.with_rigid_constraints() is not simulator:
        return ()
    return (
        "the model's <equality> constraints are taken as rigid: MuJoCo's own are soft where no solref and solimp are "
        "given; the refined model keeps them so",
    )


def start_notes(fit_runs: Measurement, simulator: Identifiable) -> tuple[str, ...]:
    """That no command was given before the runs, where the model remembers commands and that was found."""
    if not fit_runs.idle_before or not remembers_commands(simulator):
        return ()
    return (
        "the log does not say what was commanded before a run's first row; no command at all is taken: had the first "
        "row's command been given before, too, the model would follow the log less well",
    )
