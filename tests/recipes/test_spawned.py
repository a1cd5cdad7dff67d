"""Jobs in processes: results, time limits, errors and deaths, and the rest goes on."""

from __future__ import annotations

import os
import time
from functools import partial

import pytest

from recipes.studies.spawned import Failed, spawned


def act(job: str) -> str:
    if job == "sleep":
        time.sleep(300)
    if job == "raise":
        raise ValueError("no such\nthing")
    if job == "die":
        os._exit(3)
    return job.upper()


@pytest.mark.slow
def test_every_job_ends_whatever_it_does() -> None:
    began, asked = time.monotonic(), ["a", "sleep", "raise", "die", "b", "c"]
    done = {asked[number]: result for number, result in spawned([partial(act, job) for job in asked], 2, 25.0)}
    assert {job: result for job, result in done.items() if isinstance(result, str)} == {"a": "A", "b": "B", "c": "C"}
    failed = {job: result for job, result in done.items() if isinstance(result, Failed)}
    problems = {job: result.problem for job, result in failed.items()}
    assert problems == {"sleep": "out of time", "raise": "ValueError: no such", "die": "the process died"}
    assert 25.0 <= failed["sleep"].seconds < 100.0
    assert time.monotonic() - began < 200


def test_nothing_to_do_needs_no_process() -> None:
    assert list(spawned([], 2, 1.0)) == []
