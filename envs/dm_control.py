"""Tasks of the dm_control suite by name, with physical parameters by the addresses of ``MujocoSimulator``.

    space = ParameterSpace({"body.pole_1.mass": Parameter(0.05, 0.5, "kg", "log")})
    env = TransformedEnv(suite("cartpole-swingup", space), ParameterRandomization(BoxUniform(space)))

| key               | shape              | meaning                                                            |
|-------------------|--------------------|--------------------------------------------------------------------|
| ``"observation"`` | (O,) float32       | the task's observations beside each other, in the task's order     |
| ``"theta"``       | (P,) float64       | the parameters, constant within an episode                         |
| ``"action"``      | (A,) float32       |                                                                    |

One environment is one world; ``SerialEnv(8, partial(suite, "cartpole-swingup", space))`` steps eight. Needs
``pip install 'onlinebayes[dm-control]'``. The tasks: Tassa et al., DeepMind Control Suite (2018).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import torch
from tensordict import NestedKey
from torchrl.envs import CatTensors, Compose, DMControlWrapper, DoubleToFloat, TransformedEnv

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators import Parameterized
from onlinebayes.simulators.mujoco.addresses import Address, Cell, model_array, resolve
from onlinebayes.simulators.mujoco.system import is_const_input

INERTIAL_FRAME = ("body_ipos", "body_inertial")
"""Arrays that a compiled model may have taken shortcuts around; ``MujocoSimulator`` compiles it anew for them."""


def suite(
    name: str,
    space: ParameterSpace,
    *,
    seed: int | None = None,
    seconds: float | None = None,
    frame_skip: int = 1,
    observation_key: NestedKey = "observation",
    theta_key: NestedKey = "theta",
) -> Parameterized:
    """One world of a task.

    Args:
        name: domain and task, ``"cartpole-swingup"`` or ``"walker-walk"``.
        space: the free parameters by address, ``"body.pole_1.mass"`` or ``"joint.hinge_1.damping"``.
        seed: of the start states; ``set_seed`` sets another.
        seconds: length of an episode [s]; the task's own without it.
        frame_skip: steps that an action is held for.
        observation_key: of the observation.
        theta_key: of the parameters. A world that is given none has the model's own values, within their bounds.

    Raises:
        BadInput: an unknown task or address, two addresses of one value, an address that a compiled model cannot take.
    """
    world = _load(name, seed, seconds)
    model = world.physics.model.ptr
    write = WriteModel(model, space)
    wrapped = DMControlWrapper(world, frame_skip=frame_skip)
    keys = list(wrapped.observation_spec.keys())
    env = TransformedEnv(
        wrapped,
        Compose(
            CatTensors(keys, out_key=observation_key, sort=False),
            DoubleToFloat([observation_key, "reward"], in_keys_inv=["action"]),
        ),
    )
    return Parameterized(env, space, write, nominal=write.nominal(model), theta_key=theta_key)


class WriteModel:
    """Write parameters into the model of a dm_control environment; constants that follow from them follow.

    Args:
        model: the compiled model.
        space: the parameters by address.

    Raises:
        BadInput: as for :func:`suite`.
    """

    def __init__(self, model: mujoco.MjModel, space: ParameterSpace) -> None:
        self.space = space
        self.addresses = tuple(resolve(model, name) for name in space)
        _check(model, self.addresses)
        self._needs_const = any(is_const_input(cell.array) for a in self.addresses for cell in a.cells)

    def __call__(self, env: Any, values: Mapping[str, float]) -> None:
        """Set them all; the reset that follows starts from the changed model."""
        physics = env.physics
        for address in self.addresses:
            for cell in address.cells:
                _set(physics.model.ptr, cell, values[address.name])
        if self._needs_const:
            mujoco.mj_setConst(physics.model.ptr, physics.data.ptr)

    def nominal(self, model: mujoco.MjModel) -> torch.Tensor:
        """The model's own values, moved into their bounds (P,)."""
        own = torch.tensor([address.read(model) for address in self.addresses], dtype=torch.float64)
        return self.space.clamp(own)


def _load(name: str, seed: int | None, seconds: float | None) -> Any:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # rendering is set up at import, and tells who has no screen
            from dm_control import suite as tasks
    except ImportError:
        raise BadInput("dm_control is not installed", "pip install 'onlinebayes[dm-control]'") from None
    known = {f"{domain}-{task}": (domain, task) for domain, task in tasks.ALL_TASKS}
    if name not in known:
        raise BadInput(f"the suite has no task '{name}'", nearest(name, known))
    options = {"random": seed} | ({} if seconds is None else {"time_limit": seconds})
    return tasks.load(*known[name], task_kwargs=options)


def _check(model: mujoco.MjModel, addresses: tuple[Address, ...]) -> None:
    """Refuse what a compiled model cannot take, and values that two addresses stand for."""
    owners: dict[tuple[str, int], str] = {}
    for address in addresses:
        for cell in address.cells:
            if cell.array in INERTIAL_FRAME:
                raise BadInput(
                    f"'{address.name}' cannot be changed in a compiled model", "free the body's mass or inertia[i]"
                )
            shape = model_array(model, cell.array).shape
            for place in np.ravel(np.arange(np.prod(shape)).reshape(shape)[cell.index]).tolist():
                other = owners.setdefault((cell.array, place), address.name)
                if other != address.name:
                    problem = f"'{other}' and '{address.name}' are the same value of the model"
                    raise BadInput(problem, "leave one of them out")


def _set(model: mujoco.MjModel, cell: Cell, value: float) -> None:
    """Write one cell; some of the options are numbers, not arrays."""
    of_options = cell.array.startswith("opt.")
    owner, name = (model.opt, cell.array.removeprefix("opt.")) if of_options else (model, cell.array)
    held = getattr(owner, name)
    if isinstance(held, np.ndarray):
        held[cell.index] = cell.sign * value
    else:
        setattr(owner, name, cell.sign * value)
