"""The rigs: their equations against MuJoCo and energy, the integrator's order, true stick, cases and their files."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.rigs import KINDS, RIGS, Rig, case, effect_case, kinds, sized_case, write_case
from envs.rigs.cases import drawn_effects
from envs.rigs.equations import Lever
from envs.rigs.off_numbers import number, with_number
from envs.rigs.recording import Interference, record
from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco.addresses import resolve
from onlinebayes.simulators.mujoco.own_numbers import own_numbers

# Shapes are checked in the short cases of every rig; in long integrations the checks would take most of the time.
unchecked = pytest.mark.usefixtures("without_shape_checks")
HIDING = ("effect", "tie", "outside", "surplus", "own")
SMOOTH = ("swing", "cart_pole", "two_link_arm", "six_joint_arm")


def engineers_model(rig: Rig, values: Mapping[str, float]) -> mujoco.MjModel:
    """The MJCF with these base parameters, written into the fields by hand."""
    model = mujoco.MjModel.from_xml_string(rig.xml)
    for address, value in values.items():
        kind, name, field = address.split(".")
        if kind == "body":
            model.body(name).mass[:] = value
        elif kind == "joint":
            model.dof_damping[model.joint(name).dofadr] = value
        elif field == "gear[0]":
            model.actuator(name).gear[0] = value
        else:
            assert field == "kp"
            model.actuator(name).gainprm[0], model.actuator(name).biasprm[1] = value, -value
    mujoco.mj_setConst(model, mujoco.MjData(model))  # bodies that only translate use a mass prepared in advance
    return model


@pytest.mark.long
@unchecked
@pytest.mark.parametrize("name", RIGS)
def test_with_nothing_hidden_agrees_with_the_engineers_model_within_a_tenth_of_the_noise(name: str) -> None:
    rig, draw = RIGS[name], np.random.default_rng(4)
    values = {address: rig.nominal[address] * draw.uniform(0.7, 1.4) for address in rig.free}
    model, n = engineers_model(rig, values), len(rig.joints)
    model.opt.timestep, model.opt.integrator = rig.protocol.step, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    # On the table MuJoCo's own friction creeps at rest and the block starts there; all else starts in motion.
    data.qvel[:] = [0.5, 0.0] if name == "pushed_block" else draw.normal(0, 0.5, n)
    plant = rig.plant(values, np.zeros((1, n)), data.qvel[None].copy())
    amplitude = np.array([actuator.reference for actuator in rig.actuators])
    phase = 0.5 * np.arange(len(amplitude))
    worst, moved = np.zeros(n), np.zeros(n)
    for k in range(round(1.0 / rig.protocol.step)):
        data.ctrl[:] = amplitude * np.sin(8.0 * k * rig.protocol.step + phase)
        plant.advance(data.ctrl[None].copy())
        mujoco.mj_step(model, data)
        worst = np.maximum(worst, np.abs(plant.q[0] - data.qpos))
        moved = np.maximum(moved, np.abs(plant.q[0]))
    assert (worst < 0.1 * rig.protocol.floor).all()
    assert (moved[: n if name != "pushed_block" else 1] > 50 * rig.protocol.floor[0]).all()


@unchecked
def test_a_servo_that_is_off_does_not_hold_its_goal() -> None:
    rig = RIGS["position_servo"]
    model = engineers_model(rig, {})
    model.opt.timestep, model.opt.integrator = rig.protocol.step, mujoco.mjtIntegrator.mjINT_RK4
    model.actuator_gainprm[:], model.actuator_biasprm[:] = 0.0, 0.0
    data = mujoco.MjData(model)
    data.qpos[:] = 0.7
    plant = rig.plant(rig.nominal, np.array([[0.7]]), np.zeros((1, 1)))
    plant.drive.on = False
    for _ in range(round(0.5 / rig.protocol.step)):
        plant.advance(np.array([[-1.0]]))
        mujoco.mj_step(model, data)
    assert abs(data.qpos[0] - 0.7) > 0.1
    assert plant.q[0, 0] == pytest.approx(data.qpos[0], abs=1e-6)


@pytest.mark.long
def test_an_outage_begins_after_four_tenths_of_a_run() -> None:
    rig = RIGS["position_servo"]
    off, on = (
        record(rig, rig.nominal, np.random.default_rng(6), runs=2, seconds=1.0, interference=interference)
        for interference in (Interference(off=0.2), None)
    )
    before = off.time <= 0.4 * off.time[-1]
    assert (off.q[before] == on.q[before]).all()
    assert (off.command == on.command).all()
    assert (off.q[~before] != on.q[~before]).any()


@unchecked
@pytest.mark.parametrize("name", SMOOTH)
def test_energy_is_kept_without_resistance(name: str) -> None:
    rig, n = RIGS[name], len(RIGS[name].joints)
    still = {key: 0.0 for key in rig.nominal if key.endswith((".damping", ".armature"))}
    # A tilted world and centres of mass off their place put every term of the equations to work.
    still |= {"gravity_tilt@world.angle": 0.2, "com_offset@fore.x": 0.05, "com_offset@bob.x": 0.05}
    still |= {"com_offset@pole.x": 0.05, "com_offset@link3.x": 0.05, "payload@link6.mass": 0.2}
    q = np.random.default_rng(2).normal(0, 0.5, (3, n))
    plant = rig.plant(still, q, q[::-1].copy(), step=5e-4)
    start = plant.equations.energy(plant.q, plant.v)
    for _ in range(400):
        plant.advance(np.zeros((3, len(rig.actuators))))
    assert np.abs(plant.q - q).max() > 0.05
    np.testing.assert_allclose(plant.equations.energy(plant.q, plant.v), start, rtol=0, atol=1e-6)


@unchecked
def test_integrator_is_of_fourth_order() -> None:
    rig = RIGS["two_link_arm"]

    def end(step: float) -> np.ndarray:
        plant = rig.plant({}, np.array([[1.0, -0.5]]), np.zeros((1, 2)), step=step)
        for _ in range(round(0.4 / step)):
            plant.advance(np.array([[1.0, 0.2]]))
        return plant.q[0]

    truth = end(1e-3)
    coarse, fine = (np.abs(end(step) - truth).max() for step in (0.02, 0.01))
    assert 12 < coarse / fine < 22


@pytest.mark.long
@unchecked
@pytest.mark.parametrize("name", ["slide_drive", "two_link_arm", "position_servo"])
def test_under_dry_friction_a_quarter_of_the_step_changes_less_than_a_tenth_of_the_noise(name: str) -> None:
    """Reversals within a step are placed in time: stopped at the step's end they cost up to 0.6 floors in a second."""
    rig = RIGS[name]
    rubbing = next(effect for effect in rig.effects if effect.key.startswith("dry_friction")).values(1.0)
    amplitude = np.array([actuator.reference for actuator in rig.actuators])

    def path(parts: int) -> np.ndarray:
        step, rows = rig.protocol.step / parts, []
        plant = rig.plant(rubbing, np.zeros((1, len(rig.joints))), np.zeros((1, len(rig.joints))), step=step)
        for k in range(round(1.0 / rig.protocol.step)):
            held = amplitude * np.sin(12.0 * k * rig.protocol.step + np.arange(len(amplitude)))
            for _ in range(parts):
                plant.advance(held[None])
            rows.append(plant.q[0])
        return np.array(rows)

    coarse, fine = path(1), path(4)
    assert ((np.sign(np.diff(fine, axis=0))[1:] != np.sign(np.diff(fine, axis=0))[:-1]).sum(0) >= 2).any()
    assert (np.abs(coarse - fine).max(0) < 0.1 * rig.protocol.floor).all()


@unchecked
def test_a_stuck_hinge_rests_exactly_and_leaves_when_overloaded() -> None:
    rig = RIGS["swing"]
    plant = rig.plant({"dry_friction@hinge.frictionloss": 0.1}, np.zeros((2, 1)), np.zeros((2, 1)))
    for _ in range(200):
        plant.advance(np.array([[0.0999], [0.1001]]))
    assert plant.q[0, 0] == 0.0
    assert plant.v[0, 0] == 0.0
    assert plant.q[1, 0] > 0


@unchecked
def test_a_swinging_hinge_comes_to_an_exact_stop_where_friction_bears_its_weight() -> None:
    plant = RIGS["swing"].plant({"dry_friction@hinge.frictionloss": 0.4}, np.array([[0.6]]), np.zeros((1, 1)))
    for _ in range(1500):
        plant.advance(np.zeros((1, 1)))
    assert plant.v[0, 0] == 0.0
    assert 0.6 * 9.81 * 0.35 * abs(math.sin(plant.q[0, 0])) <= 0.4


@unchecked
def test_a_slide_stops_where_coulombs_law_says() -> None:
    """x = v0^2 / 2 (F/m), without damping."""
    values = {"dry_friction@carriage.frictionloss": 3.0, "joint.carriage.damping": 0.0}
    plant = RIGS["slide_drive"].plant(values, np.zeros((1, 1)), np.array([[0.4]]))
    for _ in range(900):
        plant.advance(np.zeros((1, 1)))
    assert plant.v[0, 0] == 0.0
    assert plant.q[0, 0] == pytest.approx(0.4**2 / 2 / (3.0 / 6.0), abs=1e-6)


@unchecked
def test_two_links_with_a_stuck_elbow_swing_as_one_lever() -> None:
    rig = RIGS["two_link_arm"]
    values = {"dry_friction@elbow.frictionloss": 50.0, "joint.shoulder.damping": 0.0, "joint.shoulder.armature": 0.0}
    plant = rig.plant(values, np.array([[0.8, 0.0]]), np.zeros((1, 2)))
    both, fore = 1.2 + 0.7, 0.35 + 0.13
    centre = (1.2 * 0.16 + 0.7 * fore) / both
    own = 0.012 + 0.005 + 1.2 * (0.16 - centre) ** 2 + 0.7 * (fore - centre) ** 2
    lever = Lever(both, own, (0.0, -centre), (0.0, -9.81))
    q, v, h = 0.8, 0.0, rig.protocol.step
    for _ in range(500):
        plant.advance(np.zeros((1, 2)))
        q, v = _leapfrog(lever, q, v, h)
        assert plant.v[0, 1] == 0.0
    assert plant.q[0, 1] == 0.0
    assert plant.q[0, 0] == pytest.approx(q, abs=2e-6)


def _leapfrog(lever: Lever, q: float, v: float, h: float) -> tuple[float, float]:
    def slope(at: float) -> float:
        point = np.array([[at]])
        return float(-lever.bias(point, point)[0, 0] / lever.inertia(point)[0, 0, 0])

    v = v + 0.5 * h * slope(q)
    q = q + h * v
    return q, v + 0.5 * h * slope(q)


@unchecked
def test_a_delayed_sensor_looks_like_a_delayed_motor_on_one_joint() -> None:
    """The rig says so, and so it is: both readings are the undelayed motion, later."""
    rig, draw = RIGS["swing"], np.random.default_rng
    key = "actuator_delay@motor"
    assert "sensor_delay@qpos.hinge" in rig.partners((key,))
    late_motor, late_sensor = (
        record(rig, values, draw(3), runs=1, seconds=1.0)
        for values in ({f"{key}.delay": 0.01}, {"sensor_delay@qpos.hinge.delay": 0.01})
    )
    np.testing.assert_array_equal(late_motor.command, late_sensor.command)
    np.testing.assert_allclose(late_motor.reading, late_sensor.reading, rtol=0, atol=1.1 * rig.protocol.resolution[0])
    assert np.abs(late_motor.q - late_sensor.q).max() > 5 * rig.protocol.floor[0]


@unchecked
def test_runs_together_equal_runs_alone() -> None:
    rig, draw = RIGS["two_link_arm"], np.random.default_rng(0)
    values = {"dry_friction@elbow.frictionloss": 0.2, "actuator_delay@shoulder_motor.delay": 0.0033}
    q, commands = draw.normal(0, 0.3, (3, 2)), draw.normal(0, 1, (150, 3, 2))
    together = rig.plant(values, q, np.zeros((3, 2)))
    alone = rig.plant(values, q[1:2], np.zeros((1, 2)))
    for command in commands:
        together.advance(command)
        alone.advance(command[1:2])
    np.testing.assert_allclose(together.q[1], alone.q[0], rtol=0, atol=1e-12)


def test_a_delay_of_part_of_a_step_shifts_the_mean_command() -> None:
    """A constant force F from t = T on: v = F (t - T) / m, whatever the step."""
    values = {"joint.carriage.damping": 0.0, "actuator_delay@motor.delay": 0.0123}
    plant = RIGS["slide_drive"].plant(values, np.zeros((1, 1)), np.zeros((1, 1)))
    plant.advance(np.zeros((1, 1)))
    for _ in range(100):
        plant.advance(np.array([[0.3]]))
    assert plant.v[0, 0] == pytest.approx(20 * 0.3 / 6.0 * (0.1 - 0.0123), rel=1e-9)


@pytest.mark.long
@unchecked
@pytest.mark.parametrize("name", RIGS)
def test_every_hidden_effect_moves_the_rig_and_stays_finite(name: str) -> None:
    rig, n = RIGS[name], len(RIGS[name].joints)
    steps, q = 60, np.full((1, n), 0.1) * (np.arange(n) < (1 if name == "pushed_block" else n))
    # Strong enough for every limit; from nothing, for what was commanded before the log has no delay to show.
    command = np.array([[8.0 * actuator.reference for actuator in rig.actuators]])

    def end(values: Mapping[str, float]) -> np.ndarray:
        plant = rig.plant(values, q, q.copy())
        plant.advance(0 * command)
        for _ in range(steps):
            plant.advance(command)
        return plant.q[0]

    plain = end({})
    for effect in (*rig.effects, *rig.last, *rig.by_name, *rig.outside, *(tie.hidden for tie in rig.ties)):
        if not effect.key.startswith(("sensor_", "parameter_step")):
            moved = end(effect.values(2.5))
            assert np.isfinite(moved).all(), effect.key
            assert np.abs(moved - plain).max() > 0, effect.key


@pytest.mark.long
@unchecked
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_makes_a_case_that_a_problem_file_carries(kind: str, tmp_path: Path) -> None:
    made = case("thrown_ball", kind, 1001)
    assert all(np.isfinite(column).all() for table in made.columns.values() for column in table.values())
    inside = all(low <= made.truth[name] <= high for name, (low, high) in made.parameters.items())
    assert inside == (kind != "bounds")
    assert bool(made.hidden) == (kind in HIDING)
    problem = load_problem(write_case(made, tmp_path))
    assert problem.holdout == made.holdout
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert tuple(truth["hidden"]) == made.hidden
    assert "truth" not in (tmp_path / "problem.toml").read_text()


@pytest.mark.long
@pytest.mark.parametrize("name", RIGS)
def test_every_rig_makes_a_case_that_a_problem_file_carries(name: str, tmp_path: Path) -> None:
    made = case(name, "short", 3)
    problem = load_problem(write_case(made, tmp_path))
    assert set(problem.simulator.parameters) == set(made.parameters)
    first = next(iter(made.columns.values()))
    assert (np.diff(first["time"]) > 0).all()


@unchecked
@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", RIGS)
def test_every_kind_on_every_rig(name: str, kind: str, tmp_path: Path) -> None:
    for seed in range(3 if kind in kinds(name) else 0):
        made = case(name, kind, seed)
        assert (made.rig, made.kind) == (name, kind)
        assert bool(made.hidden) == (kind in HIDING)
        assert bool(made.fault) == (kind in ("bounds", "wiring"))
        assert all((table["time"][-1] < 1.0) == (kind == "short") for table in made.columns.values())
        assert all(np.isfinite(column).all() for table in made.columns.values() for column in table.values())
        load_problem(write_case(made, tmp_path))


def test_two_hidden_effects_never_look_alike() -> None:
    for rig in RIGS.values():
        drawn = [drawn_effects(rig, np.random.default_rng(seed)) for seed in range(200)]
        pairs = [(first.key, second.key) for first, second in (effects for effects in drawn if len(effects) == 2)]
        assert len(pairs) > 20
        assert not any(second in rig.partners((first,)) for first, second in pairs)


@pytest.mark.long
@unchecked
def test_a_balls_jets_show_one_ratio() -> None:
    """Mass and gains enter by gain / mass alone: a stronger jet along y is a weaker one along x on a lighter ball."""
    rig, draw = RIGS["thrown_ball"], np.random.default_rng
    jets = {"actuator_gain@jet_y.gain": 0.25}, {"actuator_gain@jet_x.gain": -0.2, "body.ball.mass": 0.12}
    one, other = (record(rig, values, draw(5), runs=2, seconds=1.0).q for values in jets)
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
    plain = record(rig, {}, draw(5), runs=2, seconds=1.0).q
    assert np.abs(one - plain).max() > 10 * rig.protocol.floor[1]


@pytest.mark.long
def test_the_seed_decides_everything() -> None:
    first, again, other = (case("thrown_ball", "short", seed) for seed in (1, 1, 2))
    assert first.truth == again.truth
    assert first.truth != other.truth
    for name, column in first.columns["fit1"].items():
        np.testing.assert_array_equal(column, again.columns["fit1"][name])
    assert not np.array_equal(first.columns["fit1"]["qpos.x"], other.columns["fit1"]["qpos.x"][: len(column)])


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("crane", "null", 0), "rig 'crane'"),
        (("swing", "nothing", 0), "kind 'nothing'"),
        (("swing", "null", -1), "-1"),
        (("pushed_block", "own", 0), "kind 'own'"),
    ],
)
def test_unknown_cases_are_refused(arguments: tuple[str, str, int], problem: str) -> None:
    with pytest.raises(BadInput, match=problem):
        case(*arguments)


@pytest.mark.parametrize(("key", "level"), [("dry_friction@moon", "weak"), ("air_drag@ball", "huge")])
def test_unknown_effects_and_levels_are_refused(key: str, level: str) -> None:
    with pytest.raises(BadInput, match="use one of"):
        effect_case("thrown_ball", key, level, 0)


# --- numbers of the model that are off -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RIGS)
def test_a_number_that_is_off_differs_in_the_model_alone_and_by_the_stated_size(name: str) -> None:
    rig = RIGS[name]
    plain = rig.xml
    for off in (*rig.surplus, *rig.own):
        before = number(plain, off.key)
        assert before == 0 or off not in rig.surplus
        changed = with_number(plain, off.key, before + off.size)
        true, wrong = (mujoco.MjModel.from_xml_string(xml) for xml in (plain, changed))
        address = resolve(wrong, off.key)
        assert address.read(wrong) - address.read(true) == pytest.approx(off.size, rel=1e-6)
        assert number(with_number(changed, off.key, before), off.key) == before
        # The machine's value lies where criticism would look for it, in the largest cases, too.
        worst = [with_number(plain, off.key, before + part * off.size) for part in (2.5, *([-2.5] * (off in rig.own)))]
        for xml in worst:
            bounds = own_numbers(mujoco.MjModel.from_xml_string(xml))[off.key]
            assert bounds.low <= before <= bounds.high


def test_numbers_that_are_off_are_not_free() -> None:
    for rig in RIGS.values():
        for off in (*rig.surplus, *rig.own):
            assert off.key not in set(rig.free) - set(off.fixed)
            assert set(off.fixed) <= set(rig.free)


@pytest.mark.long
@unchecked
def test_the_machine_does_not_know_what_is_off_in_its_model() -> None:
    rig = RIGS["swing"]
    off, plain = sized_case(rig, rig.own[0], 1.0, 900), sized_case(rig, None, 1.0, 900)
    for name, column in plain.columns["fit1"].items():
        np.testing.assert_array_equal(column, off.columns["fit1"][name])
    assert off.hidden == (rig.own[0].key,)
    assert off.truth[rig.own[0].key] == number(rig.xml, rig.own[0].key)
    assert off.xml != plain.xml


def test_a_number_along_an_axis_has_the_partners_of_its_effect() -> None:
    assert "gravity_tilt@world" in RIGS["position_servo"].partners(("com_offset@load.x",))
    assert "sensor_bias@qpos.hinge" in RIGS["swing"].partners(("com_offset@bob.x",))
