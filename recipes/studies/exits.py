"""How a study ends: bad input is one line on standard error and exit status 2, as for the commands.

SIGTERM is Ctrl-C: what a study cleans up then (the processes that share its work) it cleans up for both.
"""

import signal
import sys
from collections.abc import Callable

from onlinebayes.runs import BadInput


def status(name: str, run: Callable[[], int | None]) -> int:
    """Run a study and return its exit status.

    Args:
        name: the make target, which begins the line.
        run: the study; None is success.
    """
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return run() or 0
    except BadInput as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    finally:
        signal.signal(signal.SIGTERM, before)
