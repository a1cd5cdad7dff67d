"""The whole road on small sets whose truth is known, made with MuJoCo; the rig of tests/recipes is not MuJoCo's."""

from collections.abc import Callable

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import Criticism, Selection, compare, diagnose, refine
from onlinebayes.criticism.results import MOVES_NOTHING
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, Interrupt, Stopped
from onlinebayes.simulators.effects import ActuatorDeadZone, ConstantLoad, DryFriction, QuadraticDrag
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, NOISE, TRUTH, measure, model

FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
FEW = ["dry_friction", "quadratic_drag", "joint_stiffness", "constant_load", "actuator_delay"]
"""Candidates where the point is not the vocabulary: the whole of it takes longer."""


@pytest.fixture(scope="module")
def mended():
    return refine(model(), measure({LOAD: (0.5,)}, runs=10), holdout=["run9", "run8"])


@pytest.fixture(scope="module")
def null():
    return refine(model(), measure(runs=10), holdout=["run9", "run8"])


def test_a_hidden_load_is_named_and_sized(mended) -> None:
    assert mended.verdict == "missing_effect"
    assert mended.accepted == ("constant_load@rail",)
    load = mended.parameters["constant_load@rail.load"]
    assert load.q05 - 2 * load.sd < 0.5 < load.q95 + 2 * load.sd
    assert load.unit == "N"
    for (name, estimate), truth in zip(list(mended.parameters.items())[:2], TRUTH, strict=True):
        assert abs(estimate.mean - truth) < 5 * estimate.sd, name
    (step,) = mended.steps
    assert step.added == "constant_load@rail"
    assert step.error_after["qpos.rail"] < 0.95 * step.error_before["qpos.rail"]
    assert step.score_gain > 2 * step.score_gain_se


@pytest.mark.slow
def test_what_promises_most_is_said_before_it_is_fitted() -> None:
    lines = list[str]()
    refine(model(), measure({LOAD: (0.5,)}, runs=6), holdout=["run5"], candidates=FEW, progress=lines.append)
    named = [line for line in lines if line.startswith("so far: constant_load@rail")]
    assert "promises most, from one replay; it is not fitted yet" in named[0]
    assert "of the error is left" in named[-1]


def test_held_out_error_falls_to_the_floor(mended) -> None:
    error = mended.heldout_error
    assert error.after["qpos.rail"] < 0.5 * error.before["qpos.rail"]
    assert error.after["qpos.rail"] < 1.5 * error.noise_floor["qpos.rail"]
    assert error.noise_floor["qpos.rail"] == pytest.approx(NOISE)
    assert error.horizon_s["qpos.rail"] == pytest.approx(1.0)
    assert mended.held_out_runs == ("run9", "run8")
    assert mended.holdout_looks == 1


@pytest.mark.slow
def test_the_file_of_the_engine_errs_as_the_model_does_where_it_holds_all_of_it(mended, null) -> None:
    assert mended.file_error == mended.heldout_error.after
    assert null.file_error == null.heldout_error.after


@pytest.mark.slow
def test_the_file_of_the_engine_lacks_what_it_has_no_term_for() -> None:
    zone = ActuatorDeadZone("motor", Parameter(0.0, 1.0))
    found = refine(model(), measure({zone: (0.5,)}, runs=6), holdout=["run5"], candidates=["actuator_dead_zone"])
    assert found.accepted == (zone.key,)
    assert found.file_error["qpos.rail"] > 5 * found.heldout_error.after["qpos.rail"]


def test_what_the_free_damping_does_is_confounded(mended) -> None:
    rows = {candidate.effect: candidate for candidate in mended.candidates}
    assert rows["viscous_friction@rail"].rank is None
    assert rows["viscous_friction@rail"].confounded_with == ("joint.rail.damping",)
    assert set(FREE) <= set(rows["actuator_gain@motor"].confounded_with)
    assert rows["sensor_bias@qpos.rail"].confounded_with == (MOVES_NOTHING,)  # a slide stands wherever its encoder says
    ranks = [candidate.rank for candidate in mended.candidates if candidate.rank]
    assert ranks == list(range(1, len(ranks) + 1))
    assert len(ranks) > 10
    assert mended.candidates_tried == len(mended.candidates) > 24


def test_replays_hold_every_row_once(mended) -> None:
    for fitted in (mended.base, mended.final):
        assert [run.held_out for run in fitted.replays] == [False] * 8 + [True] * 2
        for run in fitted.replays:
            # From where the smoother sees the start from both sides to the end, without a gap.
            assert torch.allclose(run.time.diff(), torch.tensor(0.01).double())
            assert 0.0 < float(run.time[0]) < 0.2
            assert float(run.time[-1]) == pytest.approx(3.0)
            assert torch.isfinite(run.simulated).all()
            assert run.window.unique().tolist() == [0, 1, 2]
            assert run.measured.shape == run.simulated.shape == (len(run.time), 1)


def test_the_final_model_replays_its_own_error(mended) -> None:
    held = [run for run in mended.final.replays if run.held_out]
    wrong = torch.cat([run.measured - run.simulated for run in held])
    assert float(wrong.square().mean().sqrt()) == pytest.approx(mended.heldout_error.after["qpos.rail"])
    assert mended.final.simulator.parameters.names[-1] == "constant_load@rail.load"


def test_nothing_is_accepted_where_nothing_hides(null) -> None:
    assert null.verdict == "adequate"
    assert null.accepted == ()
    assert null.remainder.status == "noise"
    assert null.remainder.rms_over_floor["qpos.rail"] == pytest.approx(1.0, abs=0.06)
    assert null.final is null.base
    # What the data would have shown: far less friction than the motor's 12 N, and not nothing.
    limit = next(c.exclusion_limit for c in null.candidates if c.effect == "dry_friction@rail")
    assert 0 < limit < 0.2


@pytest.mark.long
def test_diagnose_judges_the_best_alone() -> None:
    result = diagnose(
        model(), measure({FRICTION: (1.0,), LOAD: (0.6,)}, runs=10), candidates=["dry_friction", "constant_load"]
    )
    assert result.command == "diagnose"
    assert len(result.accepted) == 1
    assert result.candidates[0].rank == 1
    assert result.candidates_tried == 2


@pytest.mark.slow
def test_compare_names_nothing() -> None:
    drag = QuadraticDrag("rail", Parameter(0.0, 5.0, "N s2/m2"))
    result = compare(model(), measure({drag: (3.0,)}, runs=8))
    assert result.verdict == "unexplained"
    assert result.only_compared
    assert result.candidates == ()
    assert result.held_out_runs == ("run6", "run7")
    assert result.failures
    assert all(0 < f.share_of_time < f.share_of_error <= 1 for f in result.failures)
    assert result.remainder.status == "structured"


@pytest.mark.long
def test_too_few_blocks_are_said_so() -> None:
    result = refine(model(), measure({FRICTION: (1.0,)}, runs=1, seconds=6.0), candidates=FEW)
    assert result.verdict == "insufficient_data"
    assert result.accepted == ()
    assert "record at least" in result.what_to_record
    assert result.heldout_error.before["qpos.rail"] > 0


def test_runs_that_never_move() -> None:
    still = measure(runs=8, seconds=2.0)
    data = still.data.clone()
    data["signal"] = 0.3 + NOISE * torch.randn(data["signal"].shape, dtype=torch.float64)
    data["command"] = torch.zeros_like(data["command"])
    result = refine(model(), Measurement(data, still.signals, still.commands, still.runs), candidates=FEW)
    assert result.verdict == "insufficient_data"
    assert "move" in result.what_to_record
    for estimate in result.parameters.values():
        assert not estimate.identifiable


@pytest.mark.long
def test_effects_added_by_hand_belong_to_the_base_model() -> None:
    result = refine(model().with_effect(LOAD), measure({LOAD: (0.5,)}, runs=8), candidates=FEW)
    assert result.verdict == "adequate"
    assert "constant_load@rail" not in {candidate.effect for candidate in result.candidates}
    assert result.base.effects == ("constant_load@rail",)


@pytest.mark.long
def test_bounds_hold() -> None:
    tight = ParameterSpace({**dict(FREE), "body.cart.mass": Parameter(3.0, 8.0, "kg")})  # the truth is 2.5
    result = compare(model(tight), measure(runs=8))
    assert result.parameters["body.cart.mass"].mean == pytest.approx(3.0)
    assert result.remainder.status == "structured"


def test_a_model_that_diverges_is_bad_input() -> None:
    # Stiff enough that the step of 10 ms explodes for every theta that is allowed.
    stiff = ParameterSpace({"joint.rail.stiffness": Parameter(1e8, 1e9, "N/m")})
    with pytest.raises(BadInput, match="diverges"):
        compare(model(stiff), measure(runs=8, seconds=2.0))


@pytest.mark.long
def test_part_of_the_box_may_diverge() -> None:
    wild = ParameterSpace({**dict(FREE), "joint.rail.stiffness": Parameter(0.0, 1e6, "N/m")})
    result = compare(model(wild), measure(runs=8, seconds=2.0))
    assert result.parameters["joint.rail.stiffness"].mean < 1.0
    assert result.remainder.status == "noise"


@pytest.mark.long
def test_a_value_on_its_bound_is_said_to_be_there() -> None:
    narrow = ParameterSpace({**dict(FREE), "body.cart.mass": Parameter(3.0, 10.0, "kg")})
    result = compare(model(narrow), measure(runs=8, seconds=2.0))
    assert result.parameters["body.cart.mass"].at_bound == "low"
    assert result.parameters["joint.rail.damping"].at_bound is None
    assert [note for note in result.notes if note.startswith("body.cart.mass ends on its bound of 3 kg")]


def test_windows_shorter_than_was_asked_for_are_said() -> None:
    asked = Selection(horizon_s=60.0, fixed_horizon=True)
    result = compare(model(), measure(runs=8, seconds=2.0), selection=asked)
    assert [note for note in result.notes if note.startswith("windows last 2 s in place of 60 s")]


@pytest.mark.long
def test_ctrl_c_within_compare_leaves_out_the_wiring_check() -> None:
    interrupt = Interrupt()
    check, lines, early = "checking signs, units and columns", list[str](), list[str]()

    def say(line: str) -> None:
        early.append(line)
        interrupt.requested |= line == check

    data = measure({LOAD: (0.5,)}, runs=8)
    stopped = compare(model(), data, progress=say, interrupt=interrupt)
    whole = compare(model(), data, progress=lines.append)
    assert stopped.interrupted
    assert not whole.interrupted
    assert stopped.heldout_error == whole.heldout_error
    assert early == lines[: lines.index(check) + 1] + lines[-2:]


@pytest.mark.parametrize("ask", [compare, diagnose, refine])
def test_a_stop_is_heeded_within_one_replay(monkeypatch: pytest.MonkeyPatch, ask: Callable[..., Criticism]) -> None:
    """Asked for in the middle of the base fit, which nothing is known before the end of."""
    interrupt, played, rollout = Interrupt(), list[bool](), MujocoSimulator.rollout

    def counted(*given: object) -> TensorDict:
        interrupt.requested = len(played) == 10
        played.append(interrupt.requested)
        return rollout(*given)

    monkeypatch.setattr(MujocoSimulator, "rollout", counted)
    with pytest.raises(Stopped):
        ask(model(), measure({LOAD: (0.5,)}, runs=8), interrupt=interrupt)
    assert played == [False] * 10 + [True]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"candidates": ["dry_fricton"]}, "nearest: dry_friction"),
        ({"candidates": ["dry_friction@rial"]}, "nearest: rail"),
        ({"holdout": ["nobody"]}, "unknown"),
        ({"holdout": [f"run{k}" for k in range(8)]}, "every run is held out"),
        ({"holdout": []}, "no run is held out"),
    ],
)
def test_bad_arguments(arguments, message) -> None:
    with pytest.raises(BadInput, match=message):
        refine(model(), measure(runs=8, seconds=1.0), **arguments)


@pytest.mark.long
def test_an_effect_may_bring_bounds_of_its_own() -> None:
    mine = QuadraticDrag("rail", Parameter(0.0, 0.5, "N s2/m2"))
    result = diagnose(model(), measure(runs=8), candidates=[mine], selection=Selection(horizon_s=0.5))
    assert [candidate.effect for candidate in result.candidates] == ["quadratic_drag@rail"]


@pytest.mark.long
@pytest.mark.parametrize(("effect", "kind"), [("dry_friction@rail", DryFriction), ("constant_load@rail", ConstantLoad)])
def test_an_effect_of_one_and_a_half_times_the_exclusion_limit_is_found(null, effect: str, kind) -> None:
    limit = next(c.exclusion_limit for c in null.candidates if c.effect == effect)
    hidden = kind("rail", Parameter(0.0, 5.0, "N"))
    held = ["run9", "run8"]
    result = refine(model(), measure({hidden: (1.5 * limit,)}, runs=10, seed=5), holdout=held, candidates=FEW)
    assert result.accepted == (effect,)
    # Over longer windows less would show, too.
    one_second = Selection(fixed_horizon=True)
    less = measure({hidden: (0.3 * limit,)}, runs=10, seed=5)
    assert refine(model(), less, holdout=held, selection=one_second, candidates=FEW).accepted == ()


def test_a_spent_budget_is_an_answer_and_no_interruption() -> None:
    result = refine(model(), measure({LOAD: (0.5,)}, runs=8), candidates=("constant_load",), budget_s=1e-3)
    assert not result.interrupted
    assert result.accepted == ()
    assert any("budget of 0.001 s" in note for note in result.notes)
