"""Gymnasium's hopper in Drake: a conforming engine, milliradians from MuJoCo."""

from __future__ import annotations

import copy
import sys

import gymnasium
import mujoco
import pytest
import torch
from tensordict import TensorDict

from envs.hopper import FRICTION, STANDARD, DrakeHopper, drake_plant, standard_hopper, standard_task
from envs.hopper.soft_contact import soft_contact
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.simulators.by_steps import by_steps
from onlinebayes.simulators.effects import DryFriction
from onlinebayes.simulators.testing import check_engine

STEPS = 50  # of 8 ms
DAMPING = "joint.leg_joint.damping"


@pytest.fixture(scope="module")
def drake() -> DrakeHopper:
    pytest.importorskip("pydrake", reason="needs the extra robotics")
    return DrakeHopper()


def paths(simulator, height: float, torque: float = 5.0, **changed: float) -> torch.Tensor:
    """Paths (8, STEPS, 6) of a slightly bent leg under random torques [N m], by default with friction .4."""
    worlds, generator = 8, torch.Generator().manual_seed(3)
    values = dict(zip(STANDARD, simulator.nominal.tolist(), strict=True)) | {FRICTION: 0.4} | changed
    theta = STANDARD.vector(values).expand(worlds, -1)
    qpos = torch.tensor([0.0, height, 0.0, -0.2, -0.2, 0.1], dtype=torch.float64).expand(worlds, -1)
    start = TensorDict({"qpos": qpos, "qvel": torch.zeros_like(qpos)}, batch_size=[worlds])
    command = torque / 200 * (2 * torch.rand(worlds, STEPS, 3, generator=generator, dtype=torch.float64) - 1)
    times = simulator.dt * torch.arange(1, STEPS + 1, dtype=torch.float64)
    path = simulator.rollout(theta, start, TensorDict({"command": command}, batch_size=[worlds, STEPS]), times)
    assert bool(path["valid"].all())
    return path["qpos"]


def gap(first: torch.Tensor, second: torch.Tensor) -> float:
    """Root mean square of the joints' difference at the end [mrad]."""
    return 1e3 * float((first - second)[:, -1, 3:].square().mean().sqrt())


def test_conformance(drake) -> None:
    check_engine(drake, 3, scale=0.3)


CHANGES = [
    {},
    {"body.torso.mass": 6.0, "body.thigh.mass": 2.0, "body.leg.mass": 4.0, "body.foot.mass": 3.0},
    {f"joint.{name}_joint.{field}": 0.5 for name in ("thigh", "leg", "foot") for field in ("damping", "armature")},
]


@pytest.mark.parametrize("changed", CHANGES, ids=["nominal", "masses", "joints"])
def test_in_the_air_it_moves_as_in_mujoco_with_any_parameters(drake, changed) -> None:
    assert gap(paths(drake, 4.0, **changed), paths(standard_hopper(threads=1), 4.0, **changed)) < 1.0


def test_in_the_air_quick_steps_are_drakes(drake) -> None:
    assert gap(paths(drake, 4.0), paths(standard_hopper(threads=1, quick=True), 4.0)) < 1e-9


def test_near_the_ground_it_is_milliradians_away(drake) -> None:
    ours, mujoco = paths(drake, 1.25), paths(standard_hopper(threads=1), 1.25)
    assert float(ours[:, -1, 1].min()) > 1.0  # in free fall it would be at .47
    assert gap(ours, mujoco) < 6.0


def test_a_firm_foot_stands_as_in_drake(drake) -> None:
    ours = paths(drake, 1.25)
    firm, soft = (gap(ours, paths(standard_hopper(threads=1, quick=True, firm=f), 1.25)) for f in (True, False))
    assert firm < 2.0 < 2 * firm < soft  # 1.1 and 5.7


def test_friction_across_the_plane_matters_to_nobody() -> None:
    across = "pair.foot.friction[1]"
    space = ParameterSpace({**STANDARD, across: Parameter(0.0, 3.0)})
    start = TensorDict({"qpos": torch.zeros(2, 6), "qvel": torch.ones(2, 6)}, batch_size=[2])
    start["qpos"][:, 1] = 1.25
    simulator = standard_hopper(space, threads=1, firm=True)
    theta = simulator.nominal.repeat(2, 1)
    theta[1, list(space).index(across)] = 0.1
    command = TensorDict({"command": torch.zeros(2, 1, 3)}, batch_size=[2, 1])
    end = simulator.rollout(theta, start, command, torch.tensor([0.4]))["qpos"]
    assert torch.equal(end[0], end[1])


def test_an_impact_is_as_soft_as_in_mujoco(drake) -> None:
    def heights(simulator) -> torch.Tensor:
        """Of the torso, upright and let fall by two millimetres (38)."""
        start = drake.state
        theta = STANDARD.vector(dict(zip(STANDARD, simulator.nominal.tolist(), strict=True)) | {FRICTION: 0.9})[None]
        command, times = torch.zeros(1, 38, 3), simulator.dt * torch.arange(1, 39, dtype=torch.float64)
        return simulator.rollout(theta, start, TensorDict({"command": command}, batch_size=[1, 38]), times)["qpos"][
            0, :, 1
        ]

    gap = heights(drake) - heights(standard_hopper(threads=1, quick=True))
    assert float(gap.abs().max()) < 0.002  # Drake's own hard contacts: .003


def test_contacts_that_no_spring_can_say_are_refused() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom name='ball' size='.1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(BadInput, match="an impedance that is the same at all depths"):
        soft_contact(model, "ball")


def test_friction_and_damping_matter_more_than_the_engine(drake) -> None:
    rough = {FRICTION: 1.0}
    ours, mujoco = paths(drake, 1.25, **rough), paths(standard_hopper(threads=1), 1.25, **rough)
    engine = float((ours - mujoco)[:, -1].square().mean().sqrt())
    for change in ({FRICTION: 0.1}, {DAMPING: 4.0}):
        assert float((paths(drake, 1.25, **rough | change) - ours)[:, -1].square().mean().sqrt()) > 4 * engine, change


def test_a_world_that_diverges_keeps_its_last_finite_state(drake) -> None:
    worlds = drake.with_worlds(3)
    held = TensorDict({"command": torch.zeros(3, 3)}, batch_size=[3])
    held["command"][1, 0] = torch.nan
    start = worlds.state
    start["qvel"][2, 4] = 1e9
    worlds.reset(worlds.theta, start)
    for _ in range(20):
        state = worlds.step(held)
    assert worlds.failed.tolist() == [False, True, True]
    assert bool(torch.cat([state["qpos"], state["qvel"]], dim=1).isfinite().all())
    assert torch.equal(state["qpos"][1], start["qpos"][1])
    worlds.reset(worlds.theta, None, torch.tensor([False, True, False]))
    assert worlds.failed.tolist() == [False, False, True]


def test_rollouts_by_steps_stop_at_steps_only(drake) -> None:
    start, theta = drake.state, drake.theta
    held = TensorDict({"command": torch.full((1, 2, 3), 0.2)}, batch_size=[1, 2])
    sparse = by_steps(drake, theta, start, held, torch.tensor([0.016, 0.04]))
    every = by_steps(drake, theta, start, held[:, [0, 0, 1, 1, 1]], 0.008 * torch.arange(1, 6))
    assert torch.equal(sparse["qpos"], every["qpos"][:, [1, 4]])
    with pytest.raises(BadInput, match="whole multiples of dt"):
        by_steps(drake, theta, start, held, torch.tensor([0.016, 0.02]))


def test_a_copy_goes_its_own_way(drake) -> None:
    first = drake.with_worlds(2)
    second = copy.deepcopy(first)
    second.step(TensorDict({"command": torch.ones(2, 3)}, batch_size=[2]))
    assert bool((first.state["qpos"] != second.state["qpos"]).any())


def test_refusals_say_what_to_do(drake, monkeypatch) -> None:
    with pytest.raises(BadInput, match=r"nearest: joint.leg_joint.damping.*known: pair"):
        DrakeHopper(ParameterSpace({"joint.leg_joint.dampin": Parameter(0, 1)}))
    with pytest.raises(BadInput, match="add the effect to MuJoCo's"):
        drake.with_effect(DryFriction("leg_joint", Parameter(0.0, 1.0)))
    monkeypatch.setitem(sys.modules, "pydrake.geometry", None)
    with pytest.raises(BadInput, match=r"pip install 'onlinebayes\[robotics\]'"):
        drake_plant.DrakePlant()


def test_the_task_and_mujocos_worlds_are_gymnasiums_hopper() -> None:
    theirs = gymnasium.make("Hopper-v5").unwrapped
    nominal = {FRICTION: 2.0}  # of the foot, the larger of its own and the floor's
    space = ParameterSpace({name: Parameter(0.05, 2.5) for name in nominal})
    ours = SimulatorEnv(standard_hopper(space, threads=1), standard_task(), seed=0)
    theirs.reset(seed=0)
    ours.simulator.reset(space.vector(nominal)[None])
    state = ours.simulator.state
    theirs.set_state(state["qpos"][0].numpy(), state["qvel"][0].numpy())
    generator = torch.Generator().manual_seed(1)
    for _ in range(60):
        action = 2 * torch.rand(1, 3, generator=generator) - 1
        observation, reward, over, _, _ = theirs.step(action[0].numpy())
        after = ours.simulator.step(TensorDict({"command": action}, batch_size=[1]))
        assert torch.allclose(ours.task.observe(after)[0], torch.from_numpy(observation).float(), atol=1e-6)
        assert bool(ours.task.terminated(after)) == over
        assert float(ours.task.reward(state, action, after)) == pytest.approx(reward, abs=1e-6)
        if over:
            break
        state = after
    assert over
