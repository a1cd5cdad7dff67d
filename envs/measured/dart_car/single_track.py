r"""A car on a plane as a single track: two axles whose tyres push sideways, a motor that pushes along.

    alpha_i = -atan(w_i / sqrt(u_i^2 + 0.5^2)),   (u_i, w_i) velocity of axle i along and across its wheels
    F_i     = grip W_i c_i alpha_i / (1 + s_i |alpha_i|),                      i = f, r (see ``tyres``)
    m (dv_x/dt - r v_y) = k throttle - d v_x - F_c sign(v_x) - F_f sin(delta)
    m (dv_y/dt + r v_x) = F_f cos(delta) + F_r
    I dr/dt             = a F_f cos(delta) - b F_r

v_x, v_y velocity of the centre of mass in the car's axes [m/s], r yaw rate [rad/s], delta steering angle [rad], a and b
distances of the axles from the centre of mass [m], W_i their loads [N], I = m a b. The 0.5 m/s keep slip angles finite
near standstill, where tyres turn stiff and nothing is asked of them. The joints are the plane's x, y and yaw of the
point that is tracked, ``AHEAD`` of the centre of mass. Textbook equations (H. B. Pacejka, "Tire and Vehicle Dynamics",
ch. 1); dimensions as given by L. Lyons, T. Niesten and L. Ferranti, "DART: A Compact Platform for Autonomous Driving
Research", IEEE Intelligent Vehicles Symposium 2024.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from envs.measured.dart_car.tyres import TyreSaturation
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Actuator, Joint, TorchSimulator

MASS_FRONT, MASS_REAR = 0.847, 0.733  # [kg], weighed
WHEELBASE = 0.1735  # [m]
TO_REAR = 0.093  # b [m]
TO_FRONT = WHEELBASE - TO_REAR  # a [m]
AHEAD = 0.115 - TO_REAR  # of the point that is tracked [m]
GRAVITY = 9.81  # [m/s^2]
SLOW = 0.5  # [m/s]
REST = 0.02  # [m/s], over which rolling friction turns round


class SingleTrack(TorchSimulator):
    """A 1/10 scale car; the command is the throttle.

    The steering is held in a run: its angle is a parameter, the sum of what was intended and a trim.

    Generalised forces act along the car, across it and about it.
    """

    physical = ParameterSpace(
        {
            "steering_angle": Parameter(-0.6, 0.6, "rad"),
            "steering_trim": Parameter(-0.3, 0.3, "rad"),
            "cornering_front": Parameter(0.1, 100.0, "1/rad"),
            "cornering_rear": Parameter(0.1, 100.0, "1/rad"),
            "grip": Parameter(0.01, 10.0, "1"),
            "gear": Parameter(0.0, 100.0, "N"),
            "damping": Parameter(0.0, 20.0, "N s/m"),
            "rolling": Parameter(0.0, 10.0, "N"),
        }
    )
    defaults = {  # noqa: RUF012
        "steering_angle": 0.0,
        "steering_trim": 0.0,
        "cornering_front": 2.5,
        "cornering_rear": 6.0,
        "grip": 1.0,
        "gear": 11.0,
        "damping": 0.8,
        "rolling": 2.2,
    }
    joints = (Joint("x", "slide"), Joint("y", "slide"), Joint("yaw", "hinge"))
    actuators = (Actuator("throttle", "x", gear="gear"),)
    bodies = {"front": (MASS_FRONT, WHEELBASE), "rear": (MASS_REAR, WHEELBASE)}  # noqa: RUF012
    laws = (TyreSaturation,)
    timestep = 0.005

    def acceleration(
        self,
        parameters: Mapping[str, Float[Tensor, " N"]],
        q: Float[Tensor, "J N"],
        v: Float[Tensor, "J N"],
        tau: Float[Tensor, "J N"],
    ) -> Float[Tensor, "J N"]:
        """Of the tracked point [m/s^2] and of the yaw [rad/s^2]; see the module."""
        cos, sin, r = torch.cos(q[2]), torch.sin(q[2]), v[2]
        along, across = cos * v[0] + sin * v[1], cos * v[1] - sin * v[0] - AHEAD * r
        delta = parameters["steering_angle"] + parameters["steering_trim"]
        front = _side_force(parameters, "front", MASS_FRONT, _slip(along, across + TO_FRONT * r, delta))
        rear = _side_force(parameters, "rear", MASS_REAR, _slip(along, across - TO_REAR * r, torch.zeros_like(delta)))
        push = tau[0] - parameters["damping"] * along - parameters["rolling"] * torch.tanh(along / REST)
        turned = front * torch.cos(delta)
        mass = MASS_FRONT + MASS_REAR
        turning = (TO_FRONT * turned - TO_REAR * rear + tau[2]) / (mass * TO_FRONT * TO_REAR)
        ahead = (push - front * torch.sin(delta)) / mass - AHEAD * r.square()
        aside = (turned + rear + tau[1]) / mass + AHEAD * turning
        return torch.stack((cos * ahead - sin * aside, sin * ahead + cos * aside, turning))


def build(parameters: ParameterSpace) -> SingleTrack:
    """The car with these free parameters, for ``model = "envs.measured.dart_car:build"``."""
    return SingleTrack(parameters)


def _slip(along: Float[Tensor, " N"], across: Float[Tensor, " N"], delta: Float[Tensor, " N"]) -> Float[Tensor, " N"]:
    """Slip angle of wheels that are turned by delta, of an axle that moves so in the car's axes [rad]."""
    cos, sin = torch.cos(delta), torch.sin(delta)
    ahead, aside = cos * along + sin * across, cos * across - sin * along
    return -torch.atan(aside / torch.sqrt(ahead.square() + SLOW**2))


def _side_force(
    parameters: Mapping[str, Tensor], axle: str, mass: float, slip: Float[Tensor, " N"]
) -> Float[Tensor, " N"]:
    """Side force of an axle at a slip angle [N]."""
    linear = parameters["grip"] * parameters[f"cornering_{axle}"] * (mass * GRAVITY) * slip
    return linear / (1 + parameters[f"tyre_saturation@{axle}.curvature"] * slip.abs())
