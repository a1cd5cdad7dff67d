"""What a wrong name may have meant."""

import pytest

from onlinebayes.runs import nearest, similar

KNOWN = ("carriage", "pole", "motor")


@pytest.mark.parametrize(
    ("name", "cure"),
    [
        ("cariage", "nearest: carriage"),
        ("MOTOR", "nearest: motor"),
        ("xyz", "known: carriage, pole, motor"),
    ],
)
def test_the_cure_names_what_is_like_it_or_what_there_is(name: str, cure: str) -> None:
    assert nearest(name, KNOWN) == cure


def test_few_or_none_are_said_where_nothing_is_alike() -> None:
    assert nearest("xyz", KNOWN, listed=2) == "known: carriage, pole"
    assert nearest("xyz", ()) == "known: none"
    assert similar("xyz", KNOWN) == []
    assert similar("mot", ("motor", "motors", "moth"), most=1) == ["moth"]
