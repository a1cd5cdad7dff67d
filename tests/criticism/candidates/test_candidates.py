"""Which candidates are offered, and within which bounds."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from envs.rigs import case, write_case
from onlinebayes.cli.problem import load_problem
from onlinebayes.criticism.candidates.candidates import grown, grown_theta, opposites, propose, trials
from onlinebayes.criticism.candidates.scales import ROOM, target_scales
from onlinebayes.criticism.judging.acceptance import contained
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.sensitivities import columns
from onlinebayes.identification.replaying.replay import rollout
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ActuatorSaturation, AsymmetricFriction, Cogging, Scales, StribeckFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, SLIDE, measure, model

SERVO = '<position name="motor" joint="rail" kp="500" kv="10"/>'
SCALES = Scales(force=12.0, speed=2.0, travel=2.0, time=0.1, unit="slide")


@pytest.fixture(scope="module")
def windows() -> Windows:
    return make_windows(model(), measure(runs=2), 1.0, 0.0, None)


def test_an_axis_is_a_candidate_of_its_own(windows: Windows) -> None:
    keys = [effect.key for effect in propose(model(), windows)]
    assert [key for key in keys if key.startswith("com_offset")] == [f"com_offset@cart.{axis}" for axis in "xyz"]
    assert len(keys) == len(set(keys)) == 24
    (whole,) = propose(model(), windows, ["com_offset@cart"])
    assert whole.parameters.names == ("x", "y", "z")


def test_what_makes_no_sense_is_not_offered(windows: Windows) -> None:
    # On slides alone a tilt is a constant load; with a hinge it is not. A fixed body carries nothing.
    assert not any("gravity_tilt" in effect.key for effect in propose(model(), windows))
    hinged = MujocoSimulator(
        SLIDE.replace('type="slide"', 'type="hinge"').replace(
            "</body></worldbody>", '</body><body name="wall"><geom size=".1"/></body></worldbody>'
        ),
        FREE,
    )
    keys = {effect.key for effect in propose(hinged, windows)}
    assert {"gravity_tilt@world.x", "gravity_tilt@world.y", "payload@cart"} <= keys
    assert "payload@wall" not in keys
    with pytest.raises(BadInput, match="no body 'wall'"):
        propose(hinged, windows, ["payload@wall"])


def test_sensors_are_candidates_at_the_measured_signals(windows: Windows) -> None:
    keys = {effect.key for effect in propose(model(), windows)}
    assert {"sensor_bias@qpos.rail", "sensor_scale@qpos.rail", "sensor_delay@qpos.rail"} <= keys
    assert not any(key.endswith("@qvel.rail") for key in keys)
    with pytest.raises(BadInput, match=r"no signal 'qvel\.rail'"):
        propose(model(), windows, ["sensor_bias@qvel.rail"])


def test_a_name_alone_is_tried_where_the_simulator_can_have_it(windows: Windows) -> None:
    slow = '<general name="slow" joint="rail" dyntype="filter" dynprm="0.1"/>'
    two = MujocoSimulator(SLIDE.replace("</actuator>", f"{slow}</actuator>"), FREE)
    driven = ("command", "enable", "history", "history_enable")
    both = replace(windows, **{name: getattr(windows, name).expand(-1, -1, 2) for name in driven})
    assert [effect.key for effect in propose(two, both, ["thermal_derating"])] == ["thermal_derating@motor"]
    (asked,) = propose(two, both, ["thermal_derating@slow"])
    with pytest.raises(BadInput, match="not linear"):
        two.with_effect(asked)


def test_bounds_come_from_the_target(windows: Windows) -> None:
    (payload,) = propose(model(), windows, ["payload"])
    assert payload.parameters["mass"].high == pytest.approx(2 * 2.0)
    scales = target_scales(model(), windows, "actuator", "motor")
    assert scales.output == scales.force == pytest.approx(float(windows.command.abs().max()))
    # A force at the rail moves the cart's 2 kg.
    assert target_scales(model(), windows, "joint", "rail").inertia == pytest.approx(2.0, rel=1e-2)


def test_a_servos_limit_is_looked_for_where_its_force_is() -> None:
    servo = MujocoSimulator(SLIDE.replace('<motor name="motor" joint="rail"/>', SERVO), FREE, threads=1)
    measurement = measure(runs=2)
    windows = make_windows(servo, measurement, 1.0, 0.0, None)
    assert servo.servos == ("rail",)
    assert model().servos == ()
    # Play behind a motor is costly to try: it is named, or it is a servo's.
    assert "backlash@rail" in {effect.key for effect in propose(servo, windows)}
    assert not any(effect.name == "backlash" for effect in propose(model(), windows))
    assert [effect.key for effect in propose(model(), windows, ["backlash"])] == ["backlash@rail"]
    (limit,) = propose(servo, windows, ["actuator_saturation"])
    trajectory = rollout(servo, windows, servo.nominal[None], windows.start[None])[0]
    q, v = trajectory["qpos"][..., 0], trajectory["qvel"][..., 0]
    force = 500 * (windows.command[..., 0] - q) - 10 * v
    largest = float(force.abs()[windows.inside].max())
    assert limit.parameters["limit"].high == pytest.approx(ROOM * largest)
    (emf,) = propose(servo, windows, ["back_emf"])
    speed = target_scales(servo, windows, "joint", "rail").speed
    assert emf.parameters["constant"].high == pytest.approx(ROOM * largest / speed)


def test_a_limit_is_tried_from_no_limit_downwards() -> None:
    effect = ActuatorSaturation("motor", Parameter(1.0, 11.0))
    assert [trial.values["limit"] for trial in trials([effect])] == pytest.approx([10.99, 9.0, 7.5, 6.0, 3.5])
    assert all(trial.reach < 0 and not trial.two_sided for trial in trials([effect]))


def test_what_a_richer_effect_contains() -> None:
    force, speed = Parameter(0.0, 1.0), Parameter(0.1, 1.0)
    assert contained(StribeckFriction("rail", force, force, speed)) == {"dry_friction@rail"}
    friction = AsymmetricFriction("rail", Parameter(0.0, 1.0), Parameter(0.0, 1.0))
    assert contained(friction) == {"dry_friction@rail"}


def test_air_and_contacts_are_tried_where_they_are_something_of_their_own(windows: Windows) -> None:
    # On a single joint air drag is a quadratic drag; a geom that touches nothing has no contacts; wind is asked for.
    names = {effect.name for effect in propose(model(), windows)}
    assert not names & {"air_drag", "wind", "contact_friction", "contact_softness"}
    drag, world, *winds = propose(model(), windows, ["air_drag", "air_drag@world", "wind"])
    assert [drag.key, world.key] == ["air_drag@cart", "air_drag@world"]
    assert [wind.key for wind in winds] == ["wind@cart.x", "wind@cart.y"]
    assert contained(winds[0]) == {"air_drag@cart"}
    speed = target_scales(model(), windows, "joint", "rail").speed
    assert drag.parameters["drag"].high == world.parameters["drag"].high == pytest.approx(98.1 * 2.0 / speed**2)
    floor = '<worldbody><geom type="plane" pos="0 0 -.1" size="9 9 .1" friction=".6"/>'
    grounded = SLIDE.replace("<worldbody>", floor).replace(
        "</body>", '<geom name="foot" size=".1" friction=".5"/></body>'
    )
    keys = {effect.key: effect for effect in propose(MujocoSimulator(grounded, FREE), windows)}
    assert keys["contact_friction@foot"].neutral == {"friction": 0.6}
    assert keys["contact_softness@foot"].neutral == {"time_constant": 0.02, "damping_ratio": 1.0}
    assert "contact_friction@cart" not in keys
    (whole,) = propose(MujocoSimulator(grounded, FREE), windows, ["contact_friction@cart"])
    assert whole.neutral == {"friction": 0.6}


@pytest.mark.slow
def test_air_drag_of_what_one_joint_moves_is_that_joints(tmp_path: Path) -> None:
    problem = load_problem(write_case(case("cart_pole", "null", 0), tmp_path))
    assert problem.simulator.moving_joints == {"cart": ("slider",), "pole": ("slider", "hinge")}
    windows = make_windows(problem.simulator, problem.measurement, 1.0, 0.0, None)
    drags = [effect.key for effect in propose(problem.simulator, windows) if effect.name == "air_drag"]
    assert drags == ["air_drag@pole"]


def test_of_two_opposite_starts_one_stands_for_both(windows: Windows) -> None:
    effects = [StribeckFriction.scaled("rail", SCALES), Cogging.scaled("rail", SCALES)]
    tried = trials(effects)
    mirrors = opposites(effects, tried)
    assert len(mirrors) == 78  # 39 periods, two phases each
    assert all(tried[i].candidate == tried[k].candidate == 1 for i, k in mirrors.items())
    i, k = next(iter(mirrors.items()))
    simulator, base = grown(model(), effects), grown_theta(model(), model().nominal, effects)
    theta = torch.stack([grown_theta(model(), model().nominal, effects, tried[j]) for j in (i, k)])
    moved, _ = columns(simulator, windows, base, theta, windows.start)
    # What is not opposite is of second order: at 2 % of the largest force a twentieth.
    assert float((moved[0] + moved[1]).norm()) < 0.1 * float(moved[0].norm())


def test_a_joint_that_sticks_has_the_bounds_of_one_that_does_not(windows: Windows) -> None:
    sticky = MujocoSimulator(SLIDE.replace('damping="1"', 'damping="1" frictionloss="3"'), FREE, threads=1)
    free, held = (target_scales(simulator, windows, "joint", "rail") for simulator in (model(), sticky))
    assert held.inertia == pytest.approx(free.inertia, rel=0.25)  # 3 N beside the 20 N that move it
    assert held.force == pytest.approx(free.force, rel=0.3)


def test_a_joint_that_stands_still_has_no_candidates_of_its_own() -> None:
    xml = SLIDE.replace("</worldbody>", '<body><joint name="idle" type="slide"/><geom size=".1"/></body></worldbody>')
    two, moving = MujocoSimulator(xml, FREE, threads=1), measure(runs=2)
    draw = torch.Generator().manual_seed(0)
    table = {
        run: {
            "time": moving.data["time"][r].numpy(),
            "ctrl.motor": moving.data["command"][r, :, 0].numpy(),
            "qpos.rail": moving.data["signal"][r, :, 0].numpy(),
            "qpos.idle": 1e-4 * torch.randn(moving.data["time"].shape[1], generator=draw, dtype=torch.float64).numpy(),
        }
        for r, run in enumerate(moving.runs)
    }
    signals = [Signal("qpos.rail", "m", sd=1e-4), Signal("qpos.idle", "m", sd=1e-4)]
    seen = make_windows(two, Measurement.from_runs(table, signals=signals, commands=["motor"]), 1.0, 0.0, None)
    keys = {effect.key for effect in propose(two, seen)}
    assert {"dry_friction@rail", "sensor_bias@qpos.rail"} <= keys
    assert not {key for key in keys if "idle" in key}
    assert [effect.key for effect in propose(two, seen, ["dry_friction@idle"])] == ["dry_friction@idle"]


@pytest.mark.parametrize("every", [2, 3])
def test_the_scales_of_a_sensor_slower_than_the_bins(windows: Windows, every: int) -> None:
    """Its bins are never neighbours: without what lies between, nothing would move."""
    shown = (torch.arange(windows.rows) % every == 0)[None, :, None]
    slow = replace(windows, observed=windows.observed & shown, measured=windows.measured & shown)
    whole, part = (target_scales(model(), one, "joint", "rail") for one in (windows, slow))
    assert part.force == pytest.approx(whole.force, rel=0.25)
    assert part.speed == pytest.approx(whole.speed, rel=0.1)
    assert part.travel == pytest.approx(whole.travel, rel=0.05)
