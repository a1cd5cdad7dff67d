"""Gymnasium's Hopper-v5: its own model file, and the parameters that MuJoCo and Drake both understand.

The file is read from the installed ``gymnasium``. Unlike ``hopper.xml`` beside this module it uses nothing that Drake
leaves out (dry friction of joints, contact masks), so that both engines simulate one machine.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium.envs.mujoco
import mujoco
import numpy as np

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

FRICTION = "pair.*.friction[0]"
"""Of the floor and each body, along the plane in which the hopper moves. Engines mix two surfaces' frictions in ways of
their own (MuJoCo takes the larger, Drake 2 a b / (a + b)); a pair's means the same in each."""

STOP = 0.012
"""Time constant of a firm foot's friction [s]. With 4 ms a foot that slides is lifted, with 20 ms one that stands
creeps: of 4, 6, 8, 12 and 20 ms, 8 and 12 come nearest to Drake's, 12 on both gaits that were looked at."""

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
    firm: bool = False,
) -> MujocoSimulator:
    """Gymnasium's hopper in MuJoCo, commanded every 8 ms.

    Args:
        parameters: the free ones, by address.
        worlds: number of worlds N.
        threads: threads that step them, 0 for all cores.
        quick: by semi-implicit steps in place of the file's Runge-Kutta: three times as fast. Without contacts these
            are Drake's steps too.
        firm: a foot that stands does not creep, as in Drake. The file's friction slows a foot by -b v, b = 2 / (.8 tau)
            with tau = 20 ms, so that it is less than mu N while the foot slips by less than mu N / (m b), some
            centimetres a second. A firm foot has tau = 12 ms for friction, and for nothing else (``solreffriction``).
    """
    spec = mujoco.MjSpec.from_file(str(STANDARD_MODEL))
    if quick:
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    pairs = _pairs_with_floor(spec)
    if firm:
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC  # the pyramid has one reference for both
        for pair in pairs:
            pair.solreffriction = [STOP, 1.0]
    return MujocoSimulator(spec, parameters, worlds, DT, threads)


def _pairs_with_floor(spec: mujoco.MjSpec) -> list[mujoco.MjsPair]:
    """The floor and each body as a pair with the contact that MuJoCo mixes from the two, all of one softness."""
    model, floor, pairs = spec.compile(), spec.geom("floor"), []
    for body in BODIES:
        geom = spec.geom(f"{body}_geom")
        one, two = model.geom(floor.name), model.geom(geom.name)
        slide, spin, roll = np.maximum(one.friction, two.friction)
        pair = spec.add_pair(name=body, geomname1=floor.name, geomname2=geom.name)
        pair.friction, pair.condim = [slide, slide, spin, roll, roll], max(one.condim[0], two.condim[0])
        pair.solref, pair.solimp, pair.margin = one.solref, one.solimp, one.margin[0] + two.margin[0]
        pairs.append(pair)
    return pairs


def standard_task(horizon: int = 1000) -> HopperTask:
    """Hopper-v5's start, observation, reward and end: fallen below .7 m, or tilted by .2 rad."""
    return HopperTask(horizon, upright=1.25, fallen=0.7 - 1.25, tilted=0.2)
