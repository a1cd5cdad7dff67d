"""Pictures of one world by MuJoCo's own renderer, on a screen or without one.

Without a display they need EGL or OSMesa (software). ``MUJOCO_GL`` chooses, as for MuJoCo itself.
"""

from __future__ import annotations

import atexit
import copy
import os
import platform
import weakref
from collections.abc import Sequence
from ctypes.util import find_library
from importlib import import_module
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, UInt8
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.runs import BadInput
from onlinebayes.simulators.drawing import Shape
from onlinebayes.simulators.mujoco.addresses import model_array
from onlinebayes.simulators.mujoco.drawing import KINDS
from onlinebayes.simulators.mujoco.host import to_host
from onlinebayes.simulators.mujoco.system import MujocoSystem

SHADOW = 1024  # pixels of the map of shadows; MuJoCo's 4096 take most of the time without a graphics card
LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
GEOMS = {kind: geom for geom, (kind, _) in KINDS.items() if kind != "mesh"}
CURE = "install libegl1 or libosmesa6 (Debian's names), or set MUJOCO_GL to egl, osmesa or glfw"


class Renderer:
    """Takes pictures of worlds of a system.

    The model's first camera is used; without one MuJoCo's free camera, which sees the whole model.

    Args:
        system: the compiled system.
        size: height and width [pixels].

    Raises:
        BadInput: the machine has no OpenGL that works.
    """

    def __init__(self, system: MujocoSystem, size: tuple[int, int]) -> None:
        self._system, self._size = system, size
        self._model = copy.copy(system.model)
        self._model.vis.global_.offheight, self._model.vis.global_.offwidth = size
        self._model.vis.quality.shadowsize = min(SHADOW, self._model.vis.quality.shadowsize)
        self._data = mujoco.MjData(self._model)
        self._gl = _gl_context(size)
        self._gl.make_current()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene, self._option = mujoco.MjvScene(self._model, 10_000), mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        mujoco.mjv_defaultFreeCamera(self._model, self._camera)
        if self._model.ncam:
            self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        # At exit it must come before MuJoCo's own end of EGL, which was registered earlier.
        atexit.register(weakref.finalize(self, _free, self._gl, self._context))

    def picture(
        self, theta: Float[Tensor, " P"], state: TensorDictBase, beside: tuple[Sequence[Shape], Float[Tensor, "S 7"]]
    ) -> UInt8[np.ndarray, "H W 3"]:
        """One world in a state of no batch size, with more shapes beside it."""
        for name, values in self._system.write(to_host(theta[None])).items():
            if not name.startswith("opt."):  # no option can be seen
                model_array(self._model, name)[...] = values[0].reshape(model_array(self._model, name).shape)
        self._data.qpos[:] = to_host(state.get("qpos"))
        mujoco.mj_forward(self._model, self._data)
        mask = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, self._data, self._option, None, self._camera, mask, self._scene)
        for shape, pose in zip(beside[0], beside[1].double().numpy(), strict=True):
            self._add(shape, pose)
        self._gl.make_current()
        rect, pixels = mujoco.MjrRect(0, 0, self._size[1], self._size[0]), np.empty((*self._size, 3), dtype=np.uint8)
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(pixels, None, rect, self._context)
        return pixels[::-1].copy()

    def _add(self, shape: Shape, pose: Float[np.ndarray, 7]) -> None:
        """One shape that is not of the model; meshes are left out."""
        if shape.kind not in GEOMS:
            return
        size, turned = np.zeros(3), np.empty(9)
        size[: len(shape.size)] = shape.size
        mujoco.mju_quat2Mat(turned, pose[3:])
        geom = self._scene.geoms[self._scene.ngeom]
        colour = np.array(shape.colour, dtype=np.float32)
        mujoco.mjv_initGeom(geom, GEOMS[shape.kind], size, pose[:3].copy(), turned, colour)
        self._scene.ngeom += 1


def _gl_context(size: tuple[int, int]) -> Any:
    """An OpenGL context of that height and width."""
    name = _backend()
    try:
        return import_module(f"mujoco.{name}").GLContext(size[1], size[0])
    except (ImportError, AttributeError, RuntimeError, OSError) as error:
        raise BadInput(f"{name} gives no OpenGL to render with", CURE) from error


def _backend() -> str:
    """Name of MuJoCo's module for the context; importing the wrong one would bar the right one."""
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in (*LIBRARIES, "glfw", "cgl"):
        return wanted
    if platform.system() == "Darwin":
        return "cgl"
    if platform.system() != "Linux" or os.environ.get("DISPLAY"):
        return "glfw"
    found = [name for name, library in LIBRARIES.items() if find_library(library)]
    if not found:
        raise BadInput("this machine has no display and no OpenGL to render without one", CURE)
    return found[0]


def _free(gl: Any, context: mujoco.MjrContext) -> None:
    gl.make_current()
    context.free()
    gl.free()
