"""Models of the Fetch tasks, from the MJCF that Gymnasium-Robotics ships, and the posture in which episodes begin.

| task    | what                                                        | extra      |
|---------|-------------------------------------------------------------|------------|
| "reach" | bring the gripper to a point in the air                     | no object  |
| "push"  | push a block of 2 kg to a point on the table                | friction 1 |
| "slide" | hit a puck so that it comes to rest out of the arm's reach  | friction .1 |

The arm is pulled by a weld between its gripper and a mocap body. Plappert et al., Multi-Goal Reinforcement Learning:
Challenging Robotics Environments and Request for Research (2018), whose numbers these are. Nothing of the package is
imported or copied; only its model files are read (``pip install 'onlinebayes[robotics]'``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
from jaxtyping import Float

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco.model import compile_spec

SUBSTEPS = 20
"""Timesteps of .002 s under one action."""

GRIP, OBJECT, HAND, MOCAP = "robot0:grip", "object0", "robot0:gripper_link", "robot0:mocap"
FINGERS = ("robot0:r_gripper_finger_joint", "robot0:l_gripper_finger_joint")

FRICTION = "geom.*b*0.friction[0]"
"""Sliding friction of ``object0`` and ``table0`` together; ``floor0`` keeps its own. MuJoCo takes the larger one of two
surfaces: alone, an object that is smoother than its table changes nothing."""

PHYSICAL = ParameterSpace(
    {FRICTION: Parameter(0.05, 2.0, "", "log"), "body.object0.mass": Parameter(0.5, 8.0, "kg", "log")}
)
"""Physical bounds, not a prior. Of "reach" nothing is free: nothing touches."""

HAND_TURN = (1.0, 0.0, 1.0, 0.0)
"""Pointing down; it is a quaternion once it is normalised."""


@dataclass(frozen=True)
class _Layout:
    """Numbers of one task: where the base stands and the object waits, how far goals and objects spread [m]."""

    base: tuple[float, float, float]
    object_start: tuple[float, ...] | None
    height: float
    goal_offset: tuple[float, float, float]
    object_range: float
    goal_range: float


_LAYOUTS: dict[str, _Layout] = {
    "reach": _Layout((0.4049, 0.48, 0.0), None, 0.2, (0.0, 0.0, 0.0), 0.15, 0.15),
    "push": _Layout((0.405, 0.48, 0.0), (1.25, 0.53, 0.4, 1, 0, 0, 0), 0.0, (0.0, 0.0, 0.0), 0.15, 0.15),
    "slide": _Layout((0.05, 0.48, 0.0), (1.7, 1.1, 0.41, 1, 0, 0, 0), -0.02, (0.4, 0.0, 0.0), 0.1, 0.3),
}

# Parts of the robot that never come near anything: what the lean model leaves out.
_IDLE = ("robot0:head_pan_link", "robot0:estop_link", "robot0:laser_link", "robot0:torso_fixed_link")
_TOUCHING = ("robot0:gripper_link", "robot0:r_gripper_finger_link", "robot0:l_gripper_finger_link")


@dataclass(frozen=True, eq=False)
class Scene:
    """A task's model with the state in which its episodes begin, but for the object's place.

    Attributes:
        name: of the task.
        lean: whether idle parts are left out.
        spec: of the model; every geom that an object can touch has a name.
        qpos, qvel: after the arm has moved into its posture [m, rad].
        grip: where the gripper is then [m].
        object_height: height of the object's centre, on which goals lie [m]; None without an object.
        goal_offset: of the goals' centre from ``grip`` [m].
        object_range, goal_range: half widths of the squares in which objects and goals are drawn [m].
        object_column: first column of the object's pose in ``qpos``; None without an object.
        fingers: columns of the right and left finger in ``qpos``; the gripper is locked.
    """

    name: str
    lean: bool
    spec: mujoco.MjSpec
    qpos: Float[np.ndarray, " nq"]
    qvel: Float[np.ndarray, " nv"]
    grip: Float[np.ndarray, " 3"]
    object_height: float | None
    goal_offset: Float[np.ndarray, " 3"]
    object_range: float
    goal_range: float
    object_column: int | None
    fingers: tuple[int, int]

    def __deepcopy__(self, memo: dict[int, Any]) -> Scene:
        """Itself: nobody changes it."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """For processes of their own, which read the model anew."""
        return scene, (self.name, self.lean)


@cache
def scene(name: str, lean: bool = False) -> Scene:
    """The scene of a task.

    Args:
        name: ``"reach"``, ``"push"`` or ``"slide"``.
        lean: leave out what never touches anything: head and sensors, the joints of the base, and collisions of all
            but gripper and fingers. About 1.7 times as fast, and not the same world: score policies on the exact one.

    Raises:
        BadInput: an unknown name, or Gymnasium-Robotics is not installed.
    """
    if name not in _LAYOUTS:
        raise BadInput(f"no Fetch task {name!r}", f"take one of {', '.join(_LAYOUTS)}")
    layout, spec = _LAYOUTS[name], mujoco.MjSpec.from_file(str(assets() / f"{name}.xml"))
    for geom in spec.geoms:
        if not geom.name and geom.parent.name == "table0":
            geom.name = "table0"
        if geom.parent.name == MOCAP:
            geom.rgba[3] = 0.0  # bars as long as the robot, which nobody wants to see
    weld = spec.equalities[0]
    weld.data[:11] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]  # gripper and mocap body in one place
    if lean:
        _thin(spec, layout.base)
    return _settled(name, lean, layout, spec)


def assets() -> Path:
    """The folder of the MJCF files."""
    found = find_spec("gymnasium_robotics")
    if found is None or found.origin is None:
        raise BadInput("Gymnasium-Robotics is not installed", "pip install 'onlinebayes[robotics]'")
    return Path(found.origin).parent / "envs" / "assets" / "fetch"


def _settled(name: str, lean: bool, layout: _Layout, spec: mujoco.MjSpec) -> Scene:
    """Pull the gripper to where episodes begin, ten actions long."""
    model = compile_spec(spec)
    data = mujoco.MjData(model)
    slides = [f"robot0:slide{i}" for i in range(3)]
    for joint, place in zip(slides, layout.base, strict=True):
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint) >= 0:
            data.joint(joint).qpos = place
    if layout.object_start is not None:
        data.joint(f"{OBJECT}:joint").qpos = layout.object_start
    mujoco.mj_forward(model, data)
    data.mocap_pos[0] = data.site(GRIP).xpos + np.array([-0.498, 0.005, -0.431 + layout.height])
    data.mocap_quat[0] = HAND_TURN
    for _ in range(10):
        mujoco.mj_step(model, data, nstep=SUBSTEPS)
    placed = layout.object_start is not None
    return Scene(
        name,
        lean,
        spec,
        data.qpos.copy(),
        data.qvel.copy(),
        data.site(GRIP).xpos.copy(),
        float(data.site(OBJECT).xpos[2]) if placed else None,
        np.array(layout.goal_offset),
        layout.object_range,
        layout.goal_range,
        int(model.joint(f"{OBJECT}:joint").qposadr[0]) if placed else None,
        cast(tuple[int, int], tuple(int(model.joint(finger).qposadr[0]) for finger in FINGERS)),
    )


def _thin(spec: mujoco.MjSpec, base: tuple[float, float, float]) -> None:
    for name in _IDLE:
        if (body := spec.body(name)) is not None:
            spec.delete(body)
    root = spec.body("robot0:base_link")
    root.pos = np.asarray(root.pos) + np.asarray(base)
    for i in range(3):
        spec.delete(spec.joint(f"robot0:slide{i}"))
    for geom in spec.geoms:
        if geom.parent.name.startswith("robot0:") and geom.parent.name not in _TOUCHING:
            geom.contype, geom.conaffinity = 0, 0
