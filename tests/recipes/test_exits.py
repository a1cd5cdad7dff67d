"""Studies refuse bad input as the commands do, and clean up on SIGTERM as on Ctrl-C."""

import os
import signal

import pytest

from onlinebayes.runs import BadInput
from recipes.studies.exits import status


def test_bad_input_is_one_line_and_status_two(capsys: pytest.CaptureFixture[str]) -> None:
    def run() -> None:
        raise BadInput("0 processes cannot judge anything", "use one or more")

    assert status("blind-rigs", run) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == "blind-rigs: 0 processes cannot judge anything; use one or more\n"


@pytest.mark.parametrize(("returned", "expected"), [(None, 0), (0, 0), (1, 1)])
def test_otherwise_the_study_says(returned: int | None, expected: int) -> None:
    assert status("emps", lambda: returned) == expected


def test_sigterm_is_ctrl_c() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        status("blind-rigs", lambda: os.kill(os.getpid(), signal.SIGTERM))
    assert signal.getsignal(signal.SIGTERM) is before
