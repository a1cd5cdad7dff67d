"""Gymnasium's Hopper-v5: its own model file, and the parameters that MuJoCo and Drake both understand.

The file is read from the installed ``gymnasium``. Unlike ``hopper.xml`` beside this module it uses nothing that Drake
leaves out (dry friction of joints, contact masks), so that both engines simulate one machine.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium.envs.mujoco
import mujoco

from envs.hopper.physics import DT
from envs.hopper.task import HopperTask
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

STANDARD_MODEL = Path(gymnasium.envs.mujoco.__file__).parent / "assets" / "hopper.xml"
"""A planar hopper of 15.8 kg; ``qpos`` is (x, height of the torso, pitch, thigh, leg, foot)."""

JOINTS = ("thigh_joint", "leg_joint", "foot_joint")
BODIES = ("torso", "thigh", "leg", "foot")
GEAR = 200.0
"""Of each motor [N m]."""

FRICTION = "geom.*.friction[0]"
"""Of foot and floor. MuJoCo takes the larger of the two (the foot has 2.0), Drake 2 a b / (a + b): only where both are
one value do the engines mean the same."""

STANDARD = ParameterSpace(
    {
        FRICTION: Parameter(0.05, 2.5),
        **{f"body.{name}.mass": Parameter(1.0, 10.0, "kg", "log") for name in BODIES},
        **{f"joint.{name}.damping": Parameter(0.0, 4.0, "N m s/rad") for name in JOINTS},
        **{f"joint.{name}.armature": Parameter(0.2, 3.0, "kg m2", "log") for name in JOINTS},
    }
)
"""Eleven parameters with physical bounds, not a prior."""


def standard_hopper(
    parameters: ParameterSpace = STANDARD,
    worlds: int = 1,
    threads: int = 0,
    quick: bool = False,
) -> MujocoSimulator:
    """Gymnasium's hopper in MuJoCo, commanded every 8 ms.

    Args:
        parameters: the free ones, by address.
        worlds: number of worlds N.
        threads: threads that step them, 0 for all cores.
        quick: by semi-implicit steps in place of the file's Runge-Kutta: three times as fast. Without contacts these
            are Drake's steps too.
    """
    spec = mujoco.MjSpec.from_file(str(STANDARD_MODEL))
    if quick:
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return MujocoSimulator(spec, parameters, worlds, DT, threads)


def standard_task(horizon: int = 1000) -> HopperTask:
    """Hopper-v5's start, observation, reward and end: fallen below .7 m, or tilted by .2 rad."""
    return HopperTask(horizon, upright=1.25, fallen=0.7 - 1.25, tilted=0.2)
