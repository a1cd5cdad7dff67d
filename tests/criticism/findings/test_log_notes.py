"""The line for what may be the log's own doing: zero, scale, lateness."""

from onlinebayes.criticism import Candidate
from onlinebayes.criticism.findings.log_notes import log_notes
from onlinebayes.identification.results import Estimate


def row(effect: str, name: str, mean: float, accepted: bool = True, equal: tuple[str, ...] = ()) -> Candidate:
    size = Estimate(mean, 0.02 * abs(mean), 0.9 * mean, 1.1 * mean, "s" if name == "delay" else "rad")
    return Candidate(
        effect, 1, 0.01, 1.0, 0.1, 9, parameters={name: size}, accepted=accepted, indistinguishable_from=equal
    )


def notes(*rows: Candidate, commands: tuple[str, ...] = ("m",)) -> str:
    return "\n".join(log_notes(rows, {}, commands, ("qpos.a", "qpos.b")))


def test_each_has_its_line() -> None:
    assert '[signals."qpos.a"] offset = -0.0005' in notes(row("sensor_bias@qpos.a", "bias", 5e-4))
    assert '[signals."qpos.a"] scale = 0.8' in notes(row("sensor_scale@qpos.a", "scale", 0.25))
    assert '[signals."qpos.a"] latency = 0.012' in notes(row("sensor_delay@qpos.a", "delay", 0.012))


def test_a_late_command_and_late_signals_are_one_in_a_replay() -> None:
    said = notes(row("actuator_delay@m", "delay", 0.012))
    assert 'latency = 0.012 under [signals."qpos.a"], [signals."qpos.b"]' in said
    assert "a replay driven by the logged commands does not tell" in said


def test_a_delay_of_one_actuator_of_two_is_not_the_logs() -> None:
    one, other = row("actuator_delay@m", "delay", 0.012), row("actuator_delay@n", "delay", 0.0121)
    assert notes(one, commands=("m", "n")) == ""
    assert "all commands act 12" in notes(one, other, commands=("m", "n"))
    assert notes(one, row("actuator_delay@n", "delay", 0.03), commands=("m", "n")) == ""


def test_what_was_refused_is_not_spoken_of() -> None:
    assert notes(row("sensor_bias@qpos.a", "bias", 5e-4, accepted=False)) == ""
    tied = row("sensor_bias@qpos.a", "bias", 5e-4, accepted=False, equal=("constant_load@a",))
    assert "offset" in notes(tied)
