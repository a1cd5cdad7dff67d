"""A last look at the command table before it is handed out: it is played on hardware."""

from __future__ import annotations

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.experiment.limits import Limits
from onlinebayes.runs import BadInput

SLACK = 1e-6  # of a limit: what the table's digits may add
CURE = "do not play it; the limits under [next] were not kept, which is a fault of the planner: please report it"


def check_table(
    time: Float[Tensor, " K"],
    command: Float[Tensor, "K U"],
    held: Float[Tensor, " U"],
    limits: Limits,
    names: Sequence[str],
) -> None:
    """Raise where a table breaks a limit of its commands, or does not begin and end at what is held.

    Args:
        time: rows [s].
        command: what is played [command units].
        held: what holds the posture in which it begins [command units].
        limits: what is admissible.
        names: of the commands.

    Raises:
        BadInput: which command, its value and the limit.
    """
    rates = ((command[1:] - command[:-1]).abs() / (time[1:] - time[:-1])[:, None]).amax(0)
    for k, name in enumerate(names):
        u, low, high = command[:, k], float(limits.command_low[k]), float(limits.command_high[k])
        slack = SLACK * max(high - low, abs(low), abs(high))
        for value in (float(u.min()), float(u.max())):
            if not low - slack <= value <= high + slack:
                raise BadInput(f"a table in which {name} is {value:.6g}, outside [{low:.6g}, {high:.6g}]", CURE)
        for value in (float(u[0]), float(u[-1])):
            if not abs(value - float(held[k])) <= slack:
                raise BadInput(f"a table that begins or ends at {name} = {value:.6g}, not {float(held[k]):.6g}", CURE)
        if not float(rates[k]) <= (1 + SLACK) * float(limits.rate[k]):
            found, most = float(rates[k]), float(limits.rate[k])
            raise BadInput(f"a table in which {name} changes by {found:.6g} a second, above {most:.6g}", CURE)
