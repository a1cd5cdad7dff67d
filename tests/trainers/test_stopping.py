"""A run that SIGTERM reaches anywhere, in the middle of a batch too, ends soon and goes on to the last bit."""

from __future__ import annotations

import os
import signal
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from tensordict import TensorDict
from torch.overrides import TorchFunctionMode

from onlinebayes.runs import Checkpoints, Grace, Interrupt, Stopped, giving_up
from onlinebayes.runs.interrupt import heeding
from onlinebayes.trainers import OnlineState, Point, Repeated, Saver, TrajectoryFormat, online, returns
from onlinebayes.trainers.checkpoint import run_state
from onlinebayes.trainers.distributed import OnRay
from onlinebayes.trainers.real import measured
from onlinebayes.transforms import ParameterRandomization
from tests.trainers.test_online import PRIOR, PROBLEM, TRUTH, build, differing

SOON = 10_000
"""Calls of torch, most of them of the checkpoint and the line that says what is kept: a tenth of a second."""


class Ending(TorchFunctionMode):
    """Counts calls of torch, and sends this process SIGTERM at one of them."""

    def __init__(self, at: int = 0) -> None:
        super().__init__()
        self.at, self.calls = at, 0

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        self.calls += 1
        if self.calls == self.at:
            os.kill(os.getpid(), signal.SIGTERM)
        return function(*args, **(kwargs or {}))


def run(folder: Path, at: int = 0) -> tuple[dict[str, Any], OnlineState, int]:
    """Begin the folder's run or go on with it; its whole state, and calls of torch after the signal."""
    trainer, state = build(epochs=6, simulations=200), OnlineState.begin(PRIOR)
    saver = Saver(trainer, Checkpoints(folder, "test"), every=0.0)
    saver.resume(state)

    def judged(state: OnlineState) -> None:
        returns(PROBLEM.worlds(4, ParameterRandomization(Point(TRUTH)), 9), trainer.objective.policy, 60)

    with Ending(at) as ending:
        trainer.run(state, on_step=judged, checkpoint=saver)
    return run_state(trainer, state), state, ending.calls - at


@pytest.mark.usefixtures("without_shape_checks")
def test_a_run_that_is_ended_anywhere_goes_on_to_the_last_bit(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(online, "Grace", partial(Grace, seconds=0.0))
    expected, _, calls = run(tmp_path / "whole")
    for i in range(4):
        folder = tmp_path / str(i)
        _, state, more = run(folder, int((i + 0.5) / 4 * calls))
        assert state.interrupted
        assert more < SOON
        assert differing(run(folder)[0], expected) == []


def test_what_is_nearly_done_comes_to_its_own_end() -> None:
    interrupt = Interrupt()
    patient, hasty = Grace(interrupt, 60.0), Grace(interrupt, 0.0)
    assert not hasty.requested
    interrupt.requested = True
    assert not patient.requested
    assert hasty.requested
    with giving_up(hasty):
        raise Stopped


def test_a_stop_is_no_fault_of_the_real_system() -> None:
    class Robot:
        def run(self, policy: Any, steps: int) -> TensorDict | None:
            raise Stopped

    with pytest.raises(Stopped):
        measured(Robot(), Repeated(), 3, TrajectoryFormat())


def _long(seconds: float) -> None:
    time.sleep(seconds)


@pytest.mark.slow
def test_workers_on_ray_are_not_waited_for() -> None:
    workers, interrupt = OnRay(1), Interrupt()
    list(workers.work(_long, [0.0]))  # which begins them
    timer = threading.Timer(1.0, setattr, (interrupt, "requested", True))
    timer.start()
    began = time.monotonic()
    try:
        with heeding(interrupt), pytest.raises(Stopped):
            list(workers.work(_long, [60.0]))
        assert time.monotonic() - began < 10
        assert list(workers.work(_long, [0.0])) == [(0, None)], "the worker that was at it has been replaced"
    finally:
        timer.cancel()
        workers.close()
