r"""A skid-steered vehicle: two tracks of wheels, each driven at a commanded speed, and a body that follows them.

    p* = g_v (u_left + u_right) / 2,   d* = g_t (u_right - u_left) / 2       travel and turn that are asked for [rad/s]
    T_w dp / dt = p* - p,   T_w dd / dt = d* - d                             as the wheels do them, w = p -+ d [rad/s]
    v_k     = r (w_right + w_left) / 2                   forward [m/s]
    omega_k = r (w_right - w_left) / b                   yaw rate [rad/s]
    (dx, dy) / dt -> R(yaw) (v_k, -x_icr omega_k),   d yaw / dt -> omega_k,       each within T_g

u_i commanded wheel speed [rad/s], of which the driver makes g_v for travel and g_t for turning: commands that were
written down for another radius and track arrive so; it has limits (see ``driver``). r radius [m], b effective track
[m], x_icr how far the centre of rotation lies in front of the body's origin [m]. The wheels' grip draws the body to its
kinematic velocity within T_g. After Mandow et al. (see ``laws``); the vehicle is the Clearpath Husky of D. Baril, S.-P.
Deschenes, L. Coupal, C. Goffin, J. Lepine, P. Giguere and F. Pomerleau, "DRIVE: Data-driven Robot Input Vector
Exploration", ICRA 2024, or their Warthog: the same model with another nominal geometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor

from envs.measured.skid_steer.driver import TravelAcceleration, TurnAcceleration, TurnLimit, WheelSaturation
from envs.measured.skid_steer.laws import SideAsymmetry, TurningSlip
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Actuator, Joint, TorchSimulator


class SkidSteer(TorchSimulator):
    """Planar motion (x, y, yaw) from the commanded speeds of the wheels of each side; its size is the Husky's."""

    physical = ParameterSpace(
        {
            "radius": Parameter(0.01, 1.0, "m"),
            "track": Parameter(0.1, 10.0, "m"),
            "x_icr": Parameter(-2.0, 2.0, "m"),
            "travel_gain": Parameter(0.0, 10.0, "1"),
            "turn_gain": Parameter(0.0, 10.0, "1"),
            "wheel_lag": Parameter(0.02, 2.0, "s"),
            "grip_lag": Parameter(0.02, 2.0, "s"),
        }
    )
    defaults = {  # noqa: RUF012
        "radius": 0.165,
        "track": 0.55,
        "x_icr": 0.0,
        "travel_gain": 1.0,
        "turn_gain": 1.0,
        "wheel_lag": 0.1,
        "grip_lag": 0.05,
    }
    joints = (
        Joint("left", "hinge"),
        Joint("right", "hinge"),
        Joint("x", "slide"),
        Joint("y", "slide"),
        Joint("yaw", "hinge"),
    )
    actuators = (Actuator("left", "left"), Actuator("right", "right"))
    bodies = {"vehicle": (50.0, 1.0)}  # noqa: RUF012
    laws = (TurningSlip, SideAsymmetry, TurnLimit, WheelSaturation, TravelAcceleration, TurnAcceleration)
    timestep = 0.01

    def rolling(self, theta: Float[Tensor, "N P"], wheels: Float[Tensor, "N 2"]) -> Float[Tensor, "N 5"]:
        """Velocities of the five joints at yaw 0 where wheels and ground grip, from the wheels' speeds [rad/s]."""
        left, right = self._rows(wheels)
        body = _rolling(self._name(self._rows(theta)), torch.zeros_like(left), left, right)
        return torch.cat((wheels, body.T), dim=1)

    def acceleration(
        self,
        parameters: Mapping[str, Float[Tensor, " N"]],
        q: Float[Tensor, "J N"],
        v: Float[Tensor, "J N"],
        tau: Float[Tensor, "J N"],
    ) -> Float[Tensor, "J N"]:
        """Of wheels [rad/s^2] and body [m/s^2, rad/s^2]; ``tau`` of the wheels is their command [rad/s]."""
        wheels = _wheels(parameters, v[0], v[1], tau[0], tau[1])
        return torch.cat((wheels, (_rolling(parameters, q[4], v[0], v[1]) - v[2:]) / parameters["grip_lag"] + tau[2:]))


@final
class Warthog(SkidSteer):
    """The same of the size by which the Warthog's commands were turned into wheel speeds."""

    defaults = {**SkidSteer.defaults, "radius": 0.3, "track": 1.1652}  # noqa: RUF012


def _rolling(
    parameters: Mapping[str, Tensor], yaw: Float[Tensor, " N"], left: Float[Tensor, " N"], right: Float[Tensor, " N"]
) -> Float[Tensor, "3 N"]:
    """Velocity of a body whose wheels grip at these speeds [m/s, m/s, rad/s]."""
    uneven = parameters["side_asymmetry@vehicle.asymmetry"]
    left, right = left * (1 - uneven), right * (1 + uneven)
    forward = 0.5 * parameters["radius"] * (right + left)
    rate = parameters["radius"] * (right - left) / parameters["track"]
    rate = rate / (1 + parameters["turning_slip@vehicle.slip"] * rate.abs())
    aside = -parameters["x_icr"] * rate
    cos, sin = torch.cos(yaw), torch.sin(yaw)
    return torch.stack((cos * forward - sin * aside, sin * forward + cos * aside, rate))


def _wheels(
    parameters: Mapping[str, Tensor],
    left: Float[Tensor, " N"],
    right: Float[Tensor, " N"],
    told_left: Float[Tensor, " N"],
    told_right: Float[Tensor, " N"],
) -> Float[Tensor, "2 N"]:
    """Accelerations of the left and the right wheels, from their speeds and their commands [rad/s^2]."""
    travel = 0.5 * parameters["travel_gain"] * (told_left + told_right)
    turn = _cut(0.5 * parameters["turn_gain"] * (told_right - told_left), parameters["turn_limit@vehicle.limit"])
    fastest = (travel.abs() + turn.abs()).clamp_min(1e-300)
    slowed = (parameters["wheel_saturation@vehicle.limit"] / fastest).clamp_max(1.0)
    faster, turns = (slowed * travel - 0.5 * (left + right)), (slowed * turn - 0.5 * (right - left))
    faster = _cut(faster / parameters["wheel_lag"], parameters["travel_acceleration@vehicle.limit"])
    turns = _cut(turns / parameters["wheel_lag"], parameters["turn_acceleration@vehicle.limit"])
    return torch.stack((faster - turns, faster + turns))


def _cut(value: Float[Tensor, " N"], limit: Float[Tensor, " N"]) -> Float[Tensor, " N"]:
    return torch.minimum(torch.maximum(value, -limit), limit)


def build(parameters: ParameterSpace) -> SkidSteer:
    """The Husky with these free parameters, for ``model = "envs.measured.skid_steer:build"``."""
    return SkidSteer(parameters)


def build_warthog(parameters: ParameterSpace) -> Warthog:
    """The Warthog with these free parameters, for ``model = "envs.measured.skid_steer:build_warthog"``."""
    return Warthog(parameters)
