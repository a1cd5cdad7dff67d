"""How a script ends as a command: exit status, one line for bad input, clean-up when stopped."""

from __future__ import annotations

import os
import signal
import sys
from dataclasses import dataclass

import pytest
import torch

from onlinebayes.experiments import STOPPED, Options, status
from onlinebayes.runs import BadInput


@dataclass(frozen=True)
class Settings:
    """Of a script."""

    processes: int = 1


@pytest.fixture(autouse=True)
def _no_arguments(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "argv", ["script"])
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)


def test_bad_input_is_one_line_and_status_two(capsys: pytest.CaptureFixture[str]) -> None:
    def play(settings: Settings) -> None:
        raise BadInput(f"{settings.processes} processes cannot judge anything", "use one or more")

    sys.argv += ["--processes", "0"]
    assert status(play, Settings, None) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == "0 processes cannot judge anything; use one or more\n"


def test_an_option_that_cannot_be_read_is_status_two(capsys: pytest.CaptureFixture[str]) -> None:
    sys.argv += ["--processes", "few"]
    with pytest.raises(SystemExit) as end:
        status(lambda _: 0, Settings, None)
    assert end.value.code == 2
    assert "few" in capsys.readouterr().err


@pytest.mark.parametrize(("returned", "expected"), [(None, 0), (0, 0), (1, 1)])
def test_otherwise_the_script_says(returned: int | None, expected: int) -> None:
    assert status(lambda _: returned, Settings, None) == expected


@pytest.mark.parametrize(("returned", "expected"), [(None, 0), (0, 0), (1, 0), (STOPPED, STOPPED)])
def test_a_short_run_says_so_and_judges_nothing(
    returned: int | None, expected: int, capsys: pytest.CaptureFixture[str]
) -> None:
    sys.argv += ["--short"]
    assert status(lambda _: returned, Options, None) == expected
    assert capsys.readouterr().out.startswith("a short run: it shows that the pieces connect, and judges nothing")


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGINT])
def test_what_is_stopped_cleans_up(sent: signal.Signals, capsys: pytest.CaptureFixture[str]) -> None:
    before, cleaned = signal.getsignal(signal.SIGTERM), []
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it

    def play(_: Settings) -> None:
        try:
            os.kill(os.getpid(), sent)
        finally:
            cleaned.append(True)

    assert status(play, Settings, None) == STOPPED
    assert cleaned == [True]
    assert capsys.readouterr().err == "stopped\n"
    assert signal.getsignal(signal.SIGTERM) is before
