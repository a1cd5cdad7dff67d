"""Two public arms, as their users have them: a folder with the model, a log under the maker's names.

| robot | package            | driven by         | names in the log     | what the model has not                  |
|-------|--------------------|-------------------|----------------------|-----------------------------------------|
| panda | gymnasium-robotics | position servos   | ``q[0]``, ``q_d[0]`` | dry friction in two joints, 8 and 4 N m |
| jaco  | dm-control         | velocity servos   | ``joint_1.cmd_vel``  | other gains and frictions, a payload    |

The Panda's log has no gripper. The Jaco's file has no actuator: its user adds the six that ``init`` asks for, with a
guess of their gain.
"""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

SECONDS, ROW = 40.0, 0.01
POSITION_SD, VELOCITY_SD = 2e-4, 2e-3
"""Scatter of the sensors [rad, rad/s]."""
SINES = 3

PANDA = """<mujoco model="panda">
  <include file="franka_assets/assets.xml"/>
  <include file="franka_assets/actuator.xml"/>
  <worldbody>
    <include file="franka_assets/chain.xml"/>
  </worldbody>
</mujoco>
"""
GAIN = 400.0
"""A user's guess of the gain of the Jaco's velocity servos [N m s/rad]."""
TRUE_GAINS = (500.0, 500.0, 500.0, 300.0, 300.0, 300.0)


@dataclass(frozen=True)
class PublicRobot:
    """An arm of J joints.

    Args:
        name: in the table.
        model: name of the model's file.
        write: puts it and what it needs into a folder.
        hide: makes the model the machine.
        hidden: effects of the machine that the model has not.
        home: posture about which it moves [rad].
        speeds: whether the servos take speeds; else positions.
        amplitude: of a joint's command [rad, or rad/s].
        columns: of the clock, and of joint k: its position, speed and command.
    """

    name: str
    model: str
    write: Callable[[Path], None]
    hide: Callable[[mujoco.MjSpec], None]
    hidden: tuple[str, ...]
    home: tuple[float, ...]
    speeds: bool
    amplitude: float
    columns: Callable[[int], tuple[str, str, str]]

    def write_machine(self, folder: Path) -> Path:
        """Write the machine beside its model."""
        spec = mujoco.MjSpec.from_file(str(folder / self.model))
        self.hide(spec)
        spec.compile()
        file = folder / "machine.xml"
        file.write_text(spec.to_xml(), encoding="utf-8")
        return file


def _panda(folder: Path) -> None:
    assets = _package("gymnasium_robotics") / "envs/assets/kitchen_franka/franka_assets"
    shutil.copytree(assets, folder / "franka_assets")
    (folder / "panda.xml").write_text(PANDA, encoding="utf-8")


def _panda_rubs(spec: mujoco.MjSpec) -> None:
    for joint, friction in (("robot:panda0_joint2", 8.0), ("robot:panda0_joint4", 4.0)):
        spec.joint(joint).frictionloss = friction


def _jaco(folder: Path) -> None:
    shutil.copytree(_package("dm_control") / "third_party/kinova", folder, dirs_exist_ok=True)
    model = folder / "jaco_arm.xml"
    added = "".join(f'<velocity name="joint_{k}" joint="joint_{k}" kv="{GAIN:g}"/>' for k in range(1, 7))
    text = model.read_text(encoding="utf-8").replace("</mujoco>", f"<actuator>{added}</actuator></mujoco>")
    model.write_text(text, encoding="utf-8")


def _jaco_holds(spec: mujoco.MjSpec) -> None:
    for joint, friction in (("joint_2", 6.0), ("joint_3", 5.0)):
        spec.joint(joint).frictionloss = friction
    for actuator, gain in zip(spec.actuators, TRUE_GAINS, strict=True):
        actuator.gainprm[0], actuator.biasprm[2] = gain, -gain
    hand = spec.body("b_6")
    hand.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.04, 0, 0], mass=0.6, contype=0, conaffinity=0)


ROBOTS = {
    "panda": PublicRobot(
        name="panda",
        model="panda.xml",
        write=_panda,
        hide=_panda_rubs,
        hidden=("dry_friction@robot:panda0_joint2", "dry_friction@robot:panda0_joint4"),
        home=(0.0, -0.3, 0.0, -2.0, 0.0, 0.2, 0.8),
        speeds=False,
        amplitude=0.35,
        columns=lambda k: (f"q[{k}]", f"dq[{k}]", f"q_d[{k}]"),
    ),
    "jaco": PublicRobot(
        name="jaco",
        model="jaco_arm.xml",
        write=_jaco,
        hide=_jaco_holds,
        hidden=("payload@b_6",),
        home=(0.0, 3.14, 3.14, 0.0, 0.0, 0.0),
        speeds=True,
        amplitude=0.5,
        columns=lambda k: (f"joint_{k + 1}.position", f"joint_{k + 1}.velocity", f"joint_{k + 1}.cmd_vel"),
    ),
}


def write_log(robot: PublicRobot, machine: Path, file: Path, seed: int) -> None:
    """Drive the machine by sums of sines, and write what its user's recorder writes.

    Args:
        robot, machine: what moves, and its file.
        file: the table.
        seed: of the sines and of the sensors' noise.
    """
    model = mujoco.MjModel.from_xml_path(str(machine))
    draw, data = np.random.default_rng(seed), mujoco.MjData(model)
    joints = len(robot.home)
    data.qpos[:joints] = robot.home
    asked = _sines(robot, draw)
    held = round(ROW / model.opt.timestep)
    rows = []
    for row, told in enumerate(asked):
        data.ctrl[:joints] = told
        seen = data.qpos[:joints] + POSITION_SD * draw.normal(size=joints)
        rates = data.qvel[:joints] + VELOCITY_SD * draw.normal(size=joints)
        rows.append((row * ROW, *seen, *rates, *told))
        mujoco.mj_step(model, data, held)
    by_kind = zip(*map(robot.columns, range(joints)), strict=True)
    head = ",".join(("time", *(name for kind in by_kind for name in kind)))
    np.savetxt(file, np.array(rows), delimiter=",", fmt="%.6g", header=head, comments="")


def _sines(robot: PublicRobot, draw: np.random.Generator) -> Float[np.ndarray, "T J"]:
    """Commands, which begin at home."""
    joints, time = len(robot.home), np.arange(round(SECONDS / ROW)) * ROW
    rates, phases = draw.uniform(0.2, 0.9, (joints, SINES)), draw.uniform(0, 2 * np.pi, (joints, SINES))
    waves = np.sin(2 * np.pi * rates * time[:, None, None] + phases).sum(-1) / 2
    if robot.speeds:
        return robot.amplitude * waves
    return np.array(robot.home) + robot.amplitude * (waves - waves[:1])


def _package(name: str) -> Path:
    """The folder of an installed package, which is not imported."""
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent
