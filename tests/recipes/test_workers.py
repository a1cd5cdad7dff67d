"""Jobs in processes: results, time limits, errors and deaths, and the rest goes on."""

from __future__ import annotations

import os
import time

from recipes.studies.blind_rigs.workers import work


def act(job: str) -> str:
    if job == "sleep":
        time.sleep(60)
    if job == "raise":
        raise ValueError("no such\nthing")
    if job == "die":
        os._exit(3)
    return job.upper()


def test_every_job_ends_whatever_it_does() -> None:
    began = time.monotonic()
    done = {item.job: item for item in work(["a", "sleep", "raise", "die", "b", "c"], act, 2, 1.0)}
    assert {job: item.result for job, item in done.items() if item.result} == {"a": "A", "b": "B", "c": "C"}
    problems = {job: item.problem for job, item in done.items() if item.problem}
    assert problems == {"sleep": "out of time", "raise": "ValueError: no such", "die": "the process died"}
    assert 1.0 <= done["sleep"].seconds < 5.0
    assert time.monotonic() - began < 30


def test_nothing_to_do_needs_no_process() -> None:
    assert list(work([], act, 2, 1.0)) == []
