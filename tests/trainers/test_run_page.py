"""What a run's page says of its steps."""

from __future__ import annotations

from onlinebayes.trainers.run_page import notes_of
from onlinebayes.trainers.state import Record


def record(step: int, *notes: str) -> Record:
    return Record(step, 0, 0, {}, {}, notes=notes)


def test_notes_that_differ_by_their_numbers_alone_are_one_line() -> None:
    records = [
        record(1, "narrowed to 98.9 % of the prior: 45 of 48 inside", "learnt nothing (loss -0.01 nats)"),
        record(2, "narrowed to 97 % of the prior: 47 of 48 inside"),
        record(3, "learnt nothing (loss 1e-05 nats)"),
        record(4, "learnt nothing (loss 0.02 nats)", "the real system failed"),
    ]
    assert notes_of(records) == [
        "steps 1 to 2: narrowed to 97 % of the prior: 47 of 48 inside",
        "steps 1, 3 to 4: learnt nothing (loss 0.02 nats)",
        "step 4: the real system failed",
    ]
    assert notes_of([]) == []
