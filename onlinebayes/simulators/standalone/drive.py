"""The force of an actuator of a slide or hinge joint, as MuJoCo computes it; :mod:`..mujoco.actuation` says more."""

from __future__ import annotations

import math

import mujoco

from onlinebayes.simulators.standalone.law import Servo, clip


class Drive:
    """f = clip((g0 + g1 l + g2 l') u + b0 + b1 l + b2 l'),   l = gear q,  l' = gear v,   on the joint: gear f.

    Args:
        model: the compiled model.
        actuator: id of an actuator that acts on a joint, without activation or delay.
    """

    def __init__(self, model: mujoco.MjModel, actuator: int) -> None:
        self.model, self.actuator = model, actuator
        self.joint = int(model.actuator_trnid[actuator, 0])
        self.ctrl = int(model.actuator_ctrladr[actuator])
        self.gear = float(model.actuator_gear[actuator, 0])

    def servo(self, u: float, q: float, v: float, gear: float) -> Servo:
        """Return its law at this command and motion; ``gear`` is that between its force and the one asked for."""
        model, i = self.model, self.actuator
        low, high = -math.inf, math.inf
        if model.actuator_forcelimited[i]:
            low, high = sorted((gear * model.actuator_forcerange[i]).tolist())
        bias = -gear * self.gear * model.actuator_biasprm[i]
        return Servo(gear * self.unlimited(u, q, v), float(bias[1]), float(bias[2]), low, high)

    def unlimited(self, u: float, q: float, v: float) -> float:
        """Return f before its limits."""
        model, i = self.model, self.actuator
        if model.actuator_ctrllimited[i]:
            u = clip(u, *model.actuator_ctrlrange[i].tolist())
        gain, bias, motion = model.actuator_gainprm[i], model.actuator_biasprm[i], (self.gear * q, self.gear * v)
        slope = float(gain[0])
        if model.actuator_gaintype[i] == int(mujoco.mjtGain.mjGAIN_AFFINE):
            slope += float(gain[1] * motion[0] + gain[2] * motion[1])
        force = slope * u
        if model.actuator_biastype[i] == int(mujoco.mjtBias.mjBIAS_AFFINE):
            force += float(bias[0] + bias[1] * motion[0] + bias[2] * motion[1])
        return force
