"""The hopper's model file and the physical parameters that may differ between worlds."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

MODEL = Path(__file__).with_name("hopper.xml")
"""A planar hopper of 14.4 kg whose hip joint, when it stands, is 1.07 m above the ground."""

DT = 0.008
"""Seconds between two commands [s]: four timesteps of the model."""

_JOINTS = ("hip", "knee", "ankle")

PHYSICAL = ParameterSpace(
    {
        "body.torso.mass": Parameter(1.5, 6.0, "kg", "log"),
        "body.thigh.mass": Parameter(1.5, 6.0, "kg", "log"),
        "body.shin.mass": Parameter(1.0, 5.0, "kg", "log"),
        "body.foot.mass": Parameter(1.5, 8.0, "kg", "log"),
        **{f"joint.{name}.damping": Parameter(0.2, 4.0, "N m s/rad", "log") for name in _JOINTS},
        **{f"joint.{name}.armature": Parameter(0.2, 2.0, "kg m2", "log") for name in _JOINTS},
        **{f"joint.{name}.frictionloss": Parameter(0.0, 3.0, "N m") for name in _JOINTS},
        **{f"actuator.{name}.gear": Parameter(90.0, 260.0, "N m") for name in _JOINTS},
        "joint.ankle.stiffness": Parameter(0.0, 20.0, "N m/rad"),
        "geom.foot.friction[0]": Parameter(0.4, 2.5),
        "geom.foot.solref[0]": Parameter(0.01, 0.05, "s"),
        "option.gravity[0]": Parameter(-0.8, 0.8, "m/s2"),
    }
)
"""Twenty parameters with physical bounds, not a prior: masses, the joints' damping, rotors and dry friction, the
strength of the motors, the ankle's spring, grip and softness of the foot, and the ground's slope as gravity."""


def hopper(parameters: ParameterSpace = PHYSICAL, worlds: int = 1, threads: int = 0) -> MujocoSimulator:
    """The hopper, commanded every :data:`DT`.

    Args:
        parameters: the free ones, by address.
        worlds: number of worlds N.
        threads: threads that step them, 0 for all cores.
    """
    return MujocoSimulator(MODEL, parameters, worlds, DT, threads)
