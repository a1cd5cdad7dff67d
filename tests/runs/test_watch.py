"""What long work keeps an eye on."""

import pytest

from onlinebayes.runs import UNWATCHED, Interrupt, Stopped, Watch, heed


def test_nobody_watches_by_default() -> None:
    UNWATCHED.say("a line")
    assert not UNWATCHED.stopped
    with UNWATCHED.giving_up(), UNWATCHED.heeded():
        heed()


def test_it_says_and_stops_as_it_is_asked() -> None:
    said: list[str] = []
    interrupt = Interrupt()
    watch = Watch(said.append, interrupt)
    assert not watch.stopped
    interrupt.requested = True
    watch.say("one")
    assert said == ["one"]
    assert watch.stopped
    with watch.giving_up():
        raise KeyboardInterrupt
    with watch.giving_up():
        heed()
        raise AssertionError
    with pytest.raises(Stopped), watch.heeded():
        heed()
