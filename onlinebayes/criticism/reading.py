"""The base model fitted to the runs, and the runs read as it follows them best: see :mod:`.wiring.readings`."""

from __future__ import annotations

from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.criticism.hypotheses.search import Search
from onlinebayes.criticism.log_faults import judged
from onlinebayes.criticism.prepared_log import PreparedLog
from onlinebayes.identification.judging.evaluator import Evaluation
from onlinebayes.identification.judging.rule import preferred
from onlinebayes.runs import Watch


def begun_as_read(task: PreparedLog, watch: Watch) -> tuple[PreparedLog, Search]:
    """The task as its base model asks it to be read, and a search that stands at that model.

    Args:
        task: read as it is where nothing asks for more.
        watch: told what is being done.

    Raises:
        BadInput: the model cannot follow the measurement.
        Stopped: it was interrupted.
    """
    search = start_search(task.simulator, task.fit_runs, watch)
    with watch.heeded():
        while (other := better_read(task, search, search.base)) is not None:
            task, search = other, start_search(other.simulator, other.fit_runs, watch)
    return task, search


def better_read(task: PreparedLog, search: Search, here: Evaluation) -> PreparedLog | None:
    """The task in the first other reading that the rule prefers; None without.

    Args:
        task: as it is read.
        search: whose evaluator fitted the model.
        here: the model that is asked.
    """
    nothing_yet = here.gains(here)[0]
    for reading in task.other_readings(here.fitted.simulator):
        search.evaluator.watch("reading the log otherwise")
        found = judged(reading, search.evaluator, here, task.fit_runs)
        if found is not None and preferred(found.gains, nothing_yet):
            return task.read(reading)
    return None
