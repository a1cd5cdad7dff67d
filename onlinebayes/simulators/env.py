"""An environment is a simulator and a task: physics from the one, observation, reward and ending from the other.

All worlds live in one TorchRL environment of batch size (N,), and steps are counted inside it, because a batched step
of TorchRL costs about a millisecond whatever N is. A world that diverges ends its episode with its last finite state.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, Self

import torch
from jaxtyping import Bool
from tensordict import NestedKey, TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Composite, Unbounded
from torchrl.envs import EnvBase

from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.snapshots import restore, snapshot
from onlinebayes.simulators.task import Task


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

    Args:
        simulator: the physics; the environment is the one who steps it.
        task: observation, reward, ending and start.
        seed: of the start states.
        observation_key: of the observation, for a task that gives one.
        theta_key: of the parameters.

    Attributes:
        seeding: the last seed that ``set_seed`` was given and how often it was called, None before; transforms that
            draw at reset follow it.

    Raises:
        BadInput: a theta that is outside its bounds or no number, when worlds reset; an observation or a reward of
            another shape than the task says, at the first reset or step.
    """

    def __init__(
        self,
        simulator: Simulator,
        task: Task,
        *,
        seed: int = 0,
        observation_key: NestedKey = "observation",
        theta_key: NestedKey = "theta",
    ) -> None:
        super().__init__(device=simulator.device, batch_size=(simulator.worlds,))
        self.simulator, self.task = simulator, task
        self.observation_key, self.theta_key = observation_key, theta_key
        n = simulator.worlds
        sizes: Mapping[NestedKey, int] = dict(task.observation_sizes) or {observation_key: task.observation_size}
        self.observation_spec = Composite(shape=(n,), device=self.device)
        for key, size in sizes.items():
            self.observation_spec[key] = Unbounded((n, size), dtype=torch.float32, device=self.device)
        self.observation_spec[theta_key] = Unbounded(
            (n, len(simulator.parameters)), dtype=simulator.dtype, device=self.device
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
        self._generator = torch.Generator(self.device).manual_seed(seed)
        self.seeding: tuple[int, int] | None = None

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

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDict:
        reset = None if tensordict is None else tensordict.get("_reset", None)
        theta = None if tensordict is None else tensordict.get(self.theta_key, None)
        if reset is None or bool(reset.all()):
            theta = self._theta if theta is None else self._admitted(theta)
            start = self.task.start(theta, self._generator)
            self._constant = self._constants(start)
            self._state = self._shown(self.simulator.reset(theta, start))
            self._theta = theta.clone()
            self._steps.zero_()
        else:
            self._reset_some(reset.reshape(self.batch_size), theta)
        off = torch.zeros(len(self._steps), 1, dtype=torch.bool, device=self.device)
        result = TensorDict(
            {"done": off, "terminated": off.clone(), "truncated": off.clone()},
            batch_size=self.batch_size,
            device=self.device,
        )
        return self._seen(self._state, result).set(self.theta_key, self._theta.clone())

    def _reset_some(self, mask: Bool[Tensor, " N"], theta: Tensor | None) -> None:
        rows = mask.nonzero().squeeze(-1)
        theta_rows = self._theta[rows] if theta is None else self._admitted(theta[rows])
        theta = self._theta.index_copy(0, rows, theta_rows)
        begun = self.task.start(theta_rows, self._generator)
        constant = self._constants(begun)
        if not constant.is_empty():
            self._constant = self._constant.apply(lambda old, new: old.index_copy(0, rows, new), constant)
        start = _scatter(begun, rows, len(mask))
        self._state, self._theta = self._shown(self.simulator.reset(theta, start, mask)), theta
        self._steps.masked_fill_(mask, 0)

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
            self._check_observations(values)
        for key, value in values.items():
            into.set(key, value)
        return into

    def _check_observations(self, values: Mapping[Any, Tensor]) -> None:
        n = len(self._steps)
        wanted, found = (
            {k: (n, size) for k, size in self._sizes.items()},
            {k: tuple(v.shape) for k, v in values.items()},
        )
        if found != wanted:
            raise BadInput(
                f"{type(self.task).__name__}.observe gave {found} for {n} worlds, the task says {wanted}",
                "make observation_size (or observation_sizes) and observe agree",
            )

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
            self._check_reward(reward)
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

    def _check_reward(self, reward: Tensor) -> None:
        if reward.shape != self._steps.shape:
            raise BadInput(
                f"{type(self.task).__name__}.reward gave shape {tuple(reward.shape)} for {len(self._steps)} worlds",
                f"give one number a world, shape ({len(self._steps)},)",
            )
        self._checked = True

    # --- copies and checkpoints -----------------------------------------------------------------------------------

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """An environment of its own that stands where this one does."""
        copied = type(self)(
            self.simulator.with_worlds(self.simulator.worlds),
            copy.deepcopy(self.task, memo),
            observation_key=self.observation_key,
            theta_key=self.theta_key,
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
        self._theta, self._steps = state["theta"].clone(), state["steps"].clone()
        constant = TensorDict(dict(state["constant"]), batch_size=self.batch_size, device=self.device)
        self._constant = constant.unflatten_keys(".")
        self._state = self._shown(self.simulator.state)
        self._generator.set_state(state["generator"])


def _scatter(values: TensorDict, rows: Tensor, worlds: int) -> TensorDict:
    """The given rows of a state of all worlds; the others are zeros, which a masked reset ignores."""
    leaves = {key: x.new_zeros(worlds, *x.shape[1:]).index_copy_(0, rows, x) for key, x in values.items()}
    return TensorDict(leaves, batch_size=(worlds,), device=values.device)
