"""The base model fitted to the runs, and the runs read as it follows them best: see :mod:`.wiring.readings`."""

from __future__ import annotations

from functools import partial

from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.criticism.hypotheses.search import Search
from onlinebayes.criticism.log_faults import judged
from onlinebayes.criticism.prepared_log import PreparedLog
from onlinebayes.identification.judging.evaluator import Evaluation
from onlinebayes.identification.judging.rule import preferred
from onlinebayes.runs import Memo, Watch, side_by_side


def begun_as_read(task: PreparedLog, watch: Watch, memo: Memo | None = None) -> tuple[PreparedLog, Search]:
    """The task as its base model asks it to be read, and a search that stands at that model.

    Args:
        task: read as it is where nothing asks for more.
        watch: told what is being done.
        memo: keeps fits for the next command.

    Raises:
        BadInput: the model cannot follow the measurement.
        Stopped: it was interrupted.
    """
    search = start_search(task.simulator, task.fit_runs, watch, memo)
    with watch.heeded():
        while (other := better_read(task, search, search.base)) is not None:
            task, search = other, start_search(other.simulator, other.fit_runs, watch, memo)
    return task, search


def better_read(task: PreparedLog, search: Search, here: Evaluation) -> PreparedLog | None:
    """The task in the first other reading that the rule prefers; None without.

    Args:
        task: as it is read.
        search: whose evaluator fitted the model.
        here: the model that is asked.
    """
    nothing_yet = here.gains(here)[0]
    readings = list(task.other_readings(here.fitted.simulator))
    if not readings:
        return None
    search.evaluator.watch("reading the log otherwise")
    found = side_by_side([partial(judged, one, search.evaluator, here, task.fit_runs) for one in readings])
    preferable = (one for one, so in zip(readings, found, strict=True) if so and preferred(so.gains, nothing_yet))
    first = next(preferable, None)
    return None if first is None else task.read(first)
