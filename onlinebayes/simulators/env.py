"""An environment is a simulator and a task: physics from the one, observation, reward and ending from the other.

All worlds live in one TorchRL environment of batch size (N,), and steps are counted inside it, because a batched step
of TorchRL costs about a millisecond whatever N is. A world that diverges ends its episode with its last finite state.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, Self

import numpy as np
import torch
from jaxtyping import Bool, UInt8
from tensordict import NestedKey, TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.pictures import Pictures
from onlinebayes.simulators.snapshots import restore, snapshot
from onlinebayes.simulators.starts import scatter, told_start
from onlinebayes.simulators.task import Task, check_observations, check_reward

SETTINGS = (
    "observation_key", "theta_key", "state_key", "with_state", "pixels_key", "from_pixels", "picture_size"
)  # fmt: skip


class SimulatorEnv(EnvBase):
    """N worlds of a simulator with a task, as one TorchRL environment.

    | key                                  | shape          | meaning                                             |
    |--------------------------------------|----------------|-----------------------------------------------------|
    | ``"observation"``                    | (N, O) float32 | what the policy sees                                |
    | ``"theta"``                          | (N, P)         | parameters of each world, constant within an episode |
    | ``"reward"``                         | (N, 1) float32 |                                                     |
    | ``"done"``, ``"terminated"``, ``"truncated"`` | (N, 1) bool | done = terminated or truncated               |

    A reset takes ``"theta"`` from the tensordict it is given (see ``ParameterRandomization``); without it worlds keep
    the theta they have, at first the simulator's nominal one.

    A task of several observations has one key each in the place of ``"observation"``.

    ``reset(tensordict, set_state=True)`` begins from the state that the tensordict holds under ``state_key``, as
    :meth:`get_state` and, with ``with_state``, every reset and step give it (see :mod:`.starts`).

    Args:
        simulator: the physics; the environment is the one who steps it.
        task: observation, reward, ending and start.
        seed: of the start states.
        observation_key: of the observation, for a task that gives one.
        theta_key: of the parameters.
        state_key: of complete states.
        with_state: write the complete state in every reset and step; transforms then pass it on to a reset.
        pixels_key: of pictures.
        from_pixels: write a picture (N, H, W, 3) uint8 in every reset and step; takes most of the time.
        picture_size: height and width of pictures [pixels].

    Attributes:
        seeding: the last seed that ``set_seed`` was given and how often it was called, None before; transforms that
            draw at reset follow it.

    Raises:
        BadInput: a theta that is outside its bounds or no number, or a state that does not fit, when worlds reset; an
            observation or a reward of another shape than the task says, at the first reset or step; ``from_pixels`` of
            a simulator that does not say what it looks like.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012
    _supports_set_state = True

    def __init__(
        self,
        simulator: Simulator,
        task: Task,
        *,
        seed: int = 0,
        observation_key: NestedKey = "observation",
        theta_key: NestedKey = "theta",
        state_key: NestedKey = "state",
        with_state: bool = False,
        pixels_key: NestedKey = "pixels",
        from_pixels: bool = False,
        picture_size: tuple[int, int] = (240, 320),
    ) -> None:
        super().__init__(device=simulator.device, batch_size=(simulator.worlds,))
        self.simulator, self.task = simulator, task
        self.observation_key, self.theta_key = observation_key, theta_key
        self.state_key, self.with_state = state_key, with_state
        self.pixels_key, self.from_pixels, self.picture_size = pixels_key, from_pixels, picture_size
        n = simulator.worlds
        sizes: Mapping[NestedKey, int] = dict(task.observation_sizes) or {observation_key: task.observation_size}
        self.observation_spec = Composite(shape=(n,), device=self.device)
        for key, size in sizes.items():
            self.observation_spec[key] = Unbounded((n, size), dtype=torch.float32, device=self.device)
        self.observation_spec[theta_key] = Unbounded(
            (n, len(simulator.parameters)), dtype=simulator.dtype, device=self.device
        )
        # A reset reads theta: transforms and environments of environments pass on what stands in the state spec.
        self.state_spec = Composite(
            {theta_key: self.observation_spec[theta_key].clone()}, shape=(n,), device=self.device
        )
        self.action_spec = task.action_spec.to(self.device).expand(n, *task.action_spec.shape)
        self.reward_spec = Unbounded((n, 1), dtype=torch.float32, device=self.device)
        done = Binary(1, shape=(n, 1), dtype=torch.bool, device=self.device)
        self.done_spec = Composite(
            done=done, terminated=done.clone(), truncated=done.clone(), shape=(n,), device=self.device
        )
        self._sizes = sizes
        self._theta = simulator.theta
        self._state = simulator.state
        self._constant = TensorDict(batch_size=(n,), device=self.device)
        self._steps = torch.zeros(n, dtype=torch.int32, device=self.device)
        self._checked = False
        self._made_pictures: Pictures | None = None
        self._generator = torch.Generator(self.device).manual_seed(seed)
        self.seeding: tuple[int, int] | None = None
        if with_state:
            self._specify_state()
        if from_pixels:
            shape = (n, *picture_size, 3)
            self._pictures()  # refuses what cannot be seen
            self.observation_spec[pixels_key] = Bounded(0, 255, shape, dtype=torch.uint8, device=self.device)

    def to(self, device: torch.device | str) -> Self:
        """The environment itself, if it is on that device.

        Raises:
            BadInput: it is on another; the simulator decides where everything is.
        """
        if torch.empty(0, device=device).device != self.device:
            raise BadInput(f"this environment is on {self.device}, not {device}", "build its simulator on that device")
        return self

    def _set_seed(self, seed: int | None) -> None:
        seed = 0 if seed is None else seed
        self._generator.manual_seed(seed)
        self.seeding = (seed, 1 if self.seeding is None else self.seeding[1] + 1)

    @classmethod
    def _complete_done(cls, done_spec: Composite, data: TensorDictBase) -> TensorDictBase:
        return data  # every step and reset writes all three; looking for missing ones takes a twentieth of a step

    def _reset(self, tensordict: TensorDictBase | None = None, *, set_state: bool = False, **_: Any) -> TensorDict:
        reset = None if tensordict is None else tensordict.get("_reset", None)
        theta = None if tensordict is None else tensordict.get(self.theta_key, None)
        told = told_start(tensordict, self.state_key, self._example()) if set_state else None
        if told is not None:
            theta = told.pop("theta", theta)
        if reset is None or bool(reset.all()):
            theta = self._theta if theta is None else self._admitted(theta)
            start, steps = self._start(theta, told)
            self._constant = self._constants(start)
            self._state = self._shown(self.simulator.reset(theta, start))
            self._theta = theta.clone()
            self._steps = torch.zeros_like(self._steps) if steps is None else steps
        else:
            self._reset_some(reset.reshape(self.batch_size), theta, told)
        off = torch.zeros(len(self._steps), 1, dtype=torch.bool, device=self.device)
        result = TensorDict(
            {"done": off, "terminated": off.clone(), "truncated": off.clone()},
            batch_size=self.batch_size,
            device=self.device,
        )
        return self._seen(self._state, result).set(self.theta_key, self._theta.clone())

    def _reset_some(self, mask: Bool[Tensor, " N"], theta: Tensor | None, told: TensorDict | None) -> None:
        rows = mask.nonzero().squeeze(-1)
        theta_rows = self._theta[rows] if theta is None else self._admitted(theta[rows])
        theta = self._theta.index_copy(0, rows, theta_rows)
        begun, steps = self._start(theta_rows, None if told is None else told[rows])
        constant = self._constants(begun)
        if not constant.is_empty():
            self._constant = self._constant.apply(lambda old, new: old.index_copy(0, rows, new), constant)
        start = scatter(begun, rows, len(mask))
        self._state, self._theta = self._shown(self.simulator.reset(theta, start, mask)), theta
        self._steps = self._steps.masked_fill(mask, 0) if steps is None else self._steps.index_copy(0, rows, steps)

    def _start(self, theta: Tensor, told: TensorDict | None) -> tuple[TensorDict, Tensor | None]:
        """The task's start, with what is told in its place, and how many steps are behind it."""
        start = self.task.start(theta, self._generator)
        if told is None:
            return start, None
        steps = told.pop("steps", None)
        return start.update(told), steps

    def _admitted(self, theta: Tensor) -> Tensor:
        """Theta in the simulator's dtype and on its device, refused outside the bounds."""
        theta = theta.to(self._theta)
        self.simulator.parameters.check(theta)
        return theta

    def _constants(self, start: TensorDict) -> TensorDict:
        """Take the task's own leaves out of a start."""
        found = start.pop("task", None)
        if found is None:
            return TensorDict(batch_size=start.batch_size, device=self.device)
        return TensorDict({"task": found}, batch_size=start.batch_size, device=self.device)

    def _shown(self, state: TensorDict) -> TensorDict:
        """A state as the task is shown it."""
        return state if self._constant.is_empty() else state.update(self._constant)

    def _seen(self, state: TensorDict, into: TensorDict) -> TensorDict:
        """Write the observations of a state."""
        observed = self.task.observe(state)
        values = observed if isinstance(observed, dict) else {self.observation_key: observed}
        if not self._checked:
            check_observations(self.task, values, self._sizes, len(self._steps))
        for key, value in values.items():
            into.set(key, value)
        if self.with_state:
            into.set(self.state_key, self._complete())
        if self.from_pixels:
            into.set(self.pixels_key, self._pictures().all(self._theta, state))
        return into

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        before, action = self._state, tensordict.get("action")
        inputs = TensorDict({"command": self.task.command(action)}, batch_size=self.batch_size, device=self.device)
        state = self._state = self._shown(self.simulator.step(inputs))
        self._steps += 1
        failed = self.simulator.failed
        terminated = (self.task.terminated(state) | failed).unsqueeze(-1)
        truncated = (self._steps >= self.task.horizon).unsqueeze(-1)
        reward = self.task.reward(before, action, state).to(torch.float32)
        if not self._checked:
            check_reward(self.task, reward, len(self._steps))
            self._checked = True
        # The action that made a world diverge may itself be no number.
        reward = torch.where(failed, reward.nan_to_num(), reward).unsqueeze(-1)
        result = TensorDict(
            {
                "reward": reward,
                "done": terminated | truncated,
                "terminated": terminated,
                "truncated": truncated,
            },
            batch_size=self.batch_size,
            device=self.device,
        )
        return self._seen(state, result).set(self.theta_key, self._theta)

    # --- states -----------------------------------------------------------------------------------------------------

    def get_state(self) -> TensorDict:
        """Return the complete state of all worlds under ``state_key``, for ``reset(tensordict, set_state=True)``."""
        return TensorDict(batch_size=self.batch_size, device=self.device).set(self.state_key, self._complete())

    def _complete(self) -> TensorDict:
        """A copy of the complete state, with theta and the steps of the episodes."""
        return self._state.clone().set("theta", self._theta.clone()).set("steps", self._steps.clone())

    def _example(self) -> TensorDict:
        """A complete state with every leaf that there may be."""
        if self._constant.is_empty():
            start = self.task.start(self._theta, torch.Generator(self.device).manual_seed(0))
            return self._complete().update(self._constants(start))
        return self._complete()

    def _specify_state(self) -> None:
        """Add the complete state to what is observed, and to what a reset reads."""
        n = self.batch_size
        spec = Composite(shape=n, device=self.device)
        for key, value in self._example().items(True, True):
            spec[key] = Unbounded(value.shape, dtype=value.dtype, device=self.device)
        self.observation_spec[self.state_key] = spec
        self.state_spec = Composite(
            {self.theta_key: self.observation_spec[self.theta_key].clone(), self.state_key: spec.clone()},
            shape=n,
            device=self.device,
        )

    def _input_td_has_state(self, tensordict: TensorDictBase | None) -> bool:
        return self.with_state and tensordict is not None and tensordict.get(self.state_key, None) is not None

    # --- pictures ---------------------------------------------------------------------------------------------------

    def render(self, mode: str = "rgb_array", *, world: int = 0) -> UInt8[np.ndarray, "H W 3"]:
        """A picture of one world.

        Raises:
            BadInput: another mode, a simulator that does not say what it looks like, no OpenGL for an MJCF.
        """
        if mode != "rgb_array":
            raise BadInput(f"mode = {mode!r}", 'this environment renders in mode "rgb_array"')
        return self._pictures().one(self._theta[world], self._state[world])

    def _pictures(self) -> Pictures:
        if self._made_pictures is None:
            self._made_pictures = Pictures(self.simulator, self.task, self.picture_size)
        return self._made_pictures

    # --- copies and checkpoints -----------------------------------------------------------------------------------

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """An environment of its own that stands where this one does."""
        copied = type(self)(
            self.simulator.with_worlds(self.simulator.worlds),
            copy.deepcopy(self.task, memo),
            **{name: getattr(self, name) for name in SETTINGS},
        )
        copied.set_extra_state(self.get_extra_state())
        return copied

    def get_extra_state(self) -> dict[str, Any]:
        """Everything that decides what comes next but the actions; a part of :meth:`state_dict`."""
        return {
            "simulator": snapshot(self.simulator),
            "theta": self._theta.clone(),
            "steps": self._steps.clone(),
            "constant": {key: value.clone() for key, value in self._constant.flatten_keys(".").items()},
            "generator": self._generator.get_state(),
            "seeding": self.seeding,
        }

    def set_extra_state(self, state: Mapping[str, Any]) -> None:
        """Stand where :meth:`get_extra_state` was taken, bit for bit.

        Raises:
            BadInput: another number of worlds or parameters.
        """
        if tuple(state["theta"].shape) != tuple(self._theta.shape):
            raise BadInput(
                f"a saved environment of shape {tuple(state['theta'].shape)} (worlds, parameters)",
                f"this one has {tuple(self._theta.shape)}: build it as it was",
            )
        restore(self.simulator, state["simulator"])
        self._theta, self._steps = (state[key].to(self.device, copy=True) for key in ("theta", "steps"))
        constant = TensorDict(dict(state["constant"]), batch_size=self.batch_size, device=self.device)
        self._constant = constant.unflatten_keys(".")
        self._state = self._shown(self.simulator.state)
        self._generator.set_state(state["generator"].cpu())
        self.seeding = None if state["seeding"] is None else tuple(state["seeding"])
