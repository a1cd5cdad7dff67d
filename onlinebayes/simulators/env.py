"""An environment is a simulator and a task: physics from the one, observation, reward and ending from the other.

    s_0 ~ start(theta),   o_k = observe(s_k),   r_k = reward(s_k, a_k, s_{k+1}),   over at ``terminated`` or ``horizon``

All worlds live in one TorchRL environment of batch size (N,), and steps are counted inside it, because a batched step
of TorchRL costs about a millisecond whatever N is. A world that diverges ends its episode with its last finite state.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Self

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Composite, TensorSpec, Unbounded
from torchrl.envs import EnvBase

from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator


class Task(ABC):
    """What is observed, rewarded and ended; knows nothing of how the worlds are simulated.

    Attributes:
        observation_size: width O of an observation.
        action_spec: TorchRL spec of one world's action, without a batch size.
        horizon: steps after which an episode is truncated.
    """

    observation_size: int
    action_spec: TensorSpec
    horizon: int

    @abstractmethod
    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """Initial states of n worlds, batch size (n,): ``"qpos"`` and ``"qvel"`` in theta's dtype and device."""

    @abstractmethod
    def observe(self, state: TensorDictBase) -> Float[Tensor, "N O"]:
        """What the policy sees of a state, in float32."""

    @abstractmethod
    def command(self, action: Tensor) -> Float[Tensor, "N U"]:
        """The simulator's commands for an action (N, ...)."""

    @abstractmethod
    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """Reward of the step from ``state`` to ``after``."""

    @abstractmethod
    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """Whether a state ends the episode."""


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

    Args:
        simulator: the physics; the environment is the one who steps it.
        task: observation, reward, ending and start.
        seed: of the start states.
    """

    def __init__(self, simulator: Simulator, task: Task, *, seed: int = 0) -> None:
        super().__init__(device=simulator.device, batch_size=(simulator.worlds,))
        self.simulator, self.task = simulator, task
        n = simulator.worlds
        self.observation_spec = Composite(
            observation=Unbounded((n, task.observation_size), dtype=torch.float32, device=self.device),
            theta=Unbounded((n, len(simulator.parameters)), dtype=simulator.dtype, device=self.device),
            shape=(n,),
            device=self.device,
        )
        self.action_spec = task.action_spec.to(self.device).expand(n, *task.action_spec.shape)
        self.reward_spec = Unbounded((n, 1), dtype=torch.float32, device=self.device)
        done = Binary(1, shape=(n, 1), dtype=torch.bool, device=self.device)
        self.done_spec = Composite(
            done=done, terminated=done.clone(), truncated=done.clone(), shape=(n,), device=self.device
        )
        self._theta = simulator.theta
        self._state = simulator.state
        self._steps = torch.zeros(n, dtype=torch.int32, device=self.device)
        self._generator = torch.Generator(self.device)
        self.set_seed(seed)

    def to(self, device: torch.device | str) -> Self:
        """The environment itself, if it is on that device.

        Raises:
            BadInput: it is on another; the simulator decides where everything is.
        """
        if torch.empty(0, device=device).device != self.device:
            raise BadInput(f"this environment is on {self.device}, not {device}", "build its simulator on that device")
        return self

    def _set_seed(self, seed: int | None) -> None:
        self._generator.manual_seed(0 if seed is None else seed)

    @classmethod
    def _complete_done(cls, done_spec: Composite, data: TensorDictBase) -> TensorDictBase:
        return data  # every step and reset writes all three; looking for missing ones takes a twentieth of a step

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDict:
        reset = None if tensordict is None else tensordict.get("_reset", None)
        theta = None if tensordict is None else tensordict.get("theta", None)
        theta = self._theta if theta is None else theta.to(self._theta)
        if reset is None or bool(reset.all()):
            self._state = self.simulator.reset(theta, self.task.start(theta, self._generator))
            self._theta = theta.clone()
            self._steps.zero_()
        else:
            mask = reset.reshape(self.batch_size)
            rows = mask.nonzero().squeeze(-1)
            theta_rows = theta[rows]
            start = _scatter(self.task.start(theta_rows, self._generator), rows, len(mask))
            self._state = self.simulator.reset(theta, start, mask)
            self._theta = self._theta.index_copy(0, rows, theta_rows)
            self._steps.masked_fill_(mask, 0)
        off = torch.zeros(len(self._steps), 1, dtype=torch.bool, device=self.device)
        return TensorDict(
            {
                "observation": self.task.observe(self._state),
                "theta": self._theta.clone(),
                "done": off,
                "terminated": off.clone(),
                "truncated": off.clone(),
            },
            batch_size=self.batch_size,
            device=self.device,
        )

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        before, action = self._state, tensordict.get("action")
        inputs = TensorDict({"command": self.task.command(action)}, batch_size=self.batch_size, device=self.device)
        state = self._state = self.simulator.step(inputs)
        self._steps += 1
        failed = self.simulator.failed
        terminated = (self.task.terminated(state) | failed).unsqueeze(-1)
        truncated = (self._steps >= self.task.horizon).unsqueeze(-1)
        reward = self.task.reward(before, action, state).to(torch.float32)
        # The action that made a world diverge may itself be no number.
        reward = torch.where(failed, reward.nan_to_num(), reward).unsqueeze(-1)
        return TensorDict(
            {
                "observation": self.task.observe(state),
                "theta": self._theta,
                "reward": reward,
                "done": terminated | truncated,
                "terminated": terminated,
                "truncated": truncated,
            },
            batch_size=self.batch_size,
            device=self.device,
        )


def _scatter(values: TensorDict, rows: Tensor, worlds: int) -> TensorDict:
    """The given rows of a state of all worlds; the others are zeros, which a masked reset ignores."""
    leaves = {key: x.new_zeros(worlds, *x.shape[1:]).index_copy_(0, rows, x) for key, x in values.items()}
    return TensorDict(leaves, batch_size=(worlds,), device=values.device)
