"""A cart-pole on ``mujoco.batch``: its model file, its physical parameters."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

MODEL = Path(__file__).with_name("cart_pole.xml")
"""A cart of 1 kg on a rail and a pole of 0.8 m; 10 N push it."""

DT = 0.04
"""Seconds between two commands [s]: four timesteps of the model."""

PHYSICAL = ParameterSpace(
    {
        "body.pole.mass": Parameter(0.02, 2.0, "kg", "log"),
        "body.cart.mass": Parameter(0.2, 5.0, "kg", "log"),
        "joint.slider.damping": Parameter(0.0, 10.0, "N s/m"),
        "actuator.motor.gear": Parameter(1.0, 50.0, "N"),
    }
)
"""Four parameters with physical bounds, not a prior."""


def cart_pole(parameters: ParameterSpace = PHYSICAL, worlds: int = 1, threads: int = 1) -> MujocoSimulator:
    """The cart-pole, commanded every :data:`DT`; the moments of inertia follow the masses.

    Args:
        parameters: the free ones, by address.
        worlds: number of worlds N.
        threads: threads that step them, 0 for all cores.
    """
    return MujocoSimulator(MODEL, parameters, worlds, DT, threads, scaled_moments=True)
