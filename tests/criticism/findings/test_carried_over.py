"""A held-out run in which the refined model errs more is named; runs that were fitted are not."""

from onlinebayes.criticism.findings.carried_over import in_vain_note, worse_runs_note
from onlinebayes.identification.detail import WindowError

UNITS = {"qpos.servo": "rad"}
FLOORS = {"qpos.servo": 0.02}


def window(run: str, before: float, after: float, held_out: bool = True) -> WindowError:
    return WindowError("qpos.servo", run, 0, held_out, 0.0, before, after)


def test_the_runs_are_named_the_worst_first() -> None:
    better = [window("slow", 0.138, 0.042), window("slow", 0.138, 0.150)]  # better as a whole
    (note,) = worse_runs_note([*better, window("fast", 0.241, 0.251), window("jump", 0.1, 0.3)], UNITS, FLOORS)
    assert "in 2 of 3 held-out comparisons" in note
    assert note.index("in “jump” 100 mrad → 300 mrad") < note.index("in “fast” 241 mrad → 251 mrad")
    assert "slow" not in note


def test_nothing_is_said_where_every_held_out_run_is_better() -> None:
    assert worse_runs_note([window("slow", 0.2, 0.1), window("fitted", 0.1, 0.2, held_out=False)], UNITS, FLOORS) == ()
    assert worse_runs_note([window("slow", 0.2, 0.202)], UNITS, FLOORS) == ()  # as good as alike
    assert worse_runs_note([], UNITS, FLOORS) == ()


def test_an_error_within_what_noise_explains_is_not_worse() -> None:
    assert worse_runs_note([window("slow", 0.010, 0.019)], UNITS, FLOORS) == ()
    (note,) = worse_runs_note([window("slow", 0.010, 0.019), window("fast", 0.010, 0.021)], UNITS, FLOORS)
    assert "in 1 of 2 held-out comparisons" in note
    assert "slow" not in note
    unknown = worse_runs_note([window("slow", 0.010, 0.019)], UNITS, {"qpos.servo": float("nan")})
    assert unknown  # no floor excuses it


def test_a_model_that_diverges_is_worse() -> None:
    (note,) = worse_runs_note([window("slow", 0.2, float("inf"))], UNITS, FLOORS)
    assert "“slow” 200 mrad" in note


def test_the_effect_with_which_the_error_rises_is_named() -> None:
    """Together the two lower the error: that the second one spoils what the first gave must not be hidden."""
    before, friction, both = {"qpos.servo": 0.226}, {"qpos.servo": 0.079}, {"qpos.servo": 0.168}
    (note,) = in_vain_note(before, [("load_dependent_friction@servo", friction)], "saturation@motor", both, UNITS)
    assert "with saturation@motor the held-out error rises (qpos.servo: 79 mrad → 168 mrad)" in note
    assert in_vain_note(before, [("load_dependent_friction@servo", both)], "saturation@motor", friction, UNITS) == ()


def test_a_single_effect_that_makes_it_worse_is_named_and_a_model_that_diverges_too() -> None:
    (note,) = in_vain_note({"qpos.servo": 0.1}, [], "wind@arm.x", {"qpos.servo": float("inf")}, UNITS)
    assert "with wind@arm.x" in note
    assert in_vain_note({"qpos.servo": 0.1}, [], "wind@arm.x", {"qpos.servo": 0.105}, UNITS) == ()  # as good as alike
    assert in_vain_note({"qpos.servo": float("nan")}, [], "wind@arm.x", {"qpos.servo": float("nan")}, UNITS) == ()
