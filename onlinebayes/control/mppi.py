"""A planner as a policy: at every step the best plan for the worlds that the belief holds possible, its first command.

    theta_k ~ belief,    u <- search(u; x_t, theta_1 ... theta_K),    action = u_1,    u <- (u_2, ..., u_H, u_H)

The equations of a search are in :mod:`.search`. The planner stands where TorchRL expects a policy, as TorchRL's own
``MPCPlannerBase`` does, but plans in a simulator whose parameters differ, in the place of one environment.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import torch
from jaxtyping import Bool, Float, Int
from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase, dispatch
from torch import Generator, Tensor
from torchrl.envs import InitTracker, Transform

from onlinebayes.control.bounds import Bounds
from onlinebayes.control.cost import Cost
from onlinebayes.control.noise import Noise
from onlinebayes.control.risk import Mean, Risk
from onlinebayes.control.rollouts import starts
from onlinebayes.control.search import Search
from onlinebayes.runs import BadInput, generator
from onlinebayes.simulators import Simulator
from onlinebayes.simulators.effects.actuator_delay import ActuatorDelay
from onlinebayes.transforms import Distribution

DRAWS = 1024
"""Draws of the belief that a planner holds, and picks its worlds from at every step."""


@dataclass(frozen=True)
class Report:
    """Diagnostics of the last plan, for a batch of B environments.

    Attributes:
        effective: number of candidates that carry the plan, of S (B,). Near 1 the temperature is too low or the noise
            too white; near S the costs hardly count.
        cost: mean cost of the candidates by their weights, over the horizon (B,).
        theta: the worlds it was made for (K, P).
        without: rollouts in each of them that have no cost: the world diverged, or the cost is no number (B, K).
    """

    effective: Float[Tensor, " B"]
    cost: Float[Tensor, " B"]
    theta: Float[Tensor, "K P"]
    without: Int[Tensor, "B K"]


class MPPI(TensorDictModuleBase):
    """Model-predictive path-integral control over a distribution of theta.

    | key             | shape          | meaning                                                        |
    |-----------------|----------------|----------------------------------------------------------------|
    | ``observation`` | (*batch, O)    | read                                                           |
    | ``is_init``     | (*batch, 1)    | optional: where an episode begins; the plan there starts anew  |
    | ``action``      | (*batch, U)    | written, float32                                               |

    Every environment of a batch is planned for. With the same seed a batch gives what each environment would alone.
    A planner holds draws of the belief and no belief; :meth:`state_dict` holds all that decides what comes next.

    Args:
        simulator: any; only ``rollout`` is used. One in float32 plans faster.
        cost: of every step; :class:`~onlinebayes.control.TaskCost` for a task.
        belief: over the simulator's parameters; without it :meth:`set_belief` must come first.
        state: observation (B, O) -> the simulator's state (B,).
        bounds: of actions, and of their change.
        noise: of the candidates.
        horizon: steps that are planned ahead H.
        samples: candidates S.
        thetas: worlds K, drawn anew at every step.
        risk: how a candidate's costs in these worlds become one.
        temperature: see :class:`~onlinebayes.control.search.Search`.
        control_cost: the same.
        iterations: searches in each step.
        command: actions (N, U) -> the simulator's commands; the same without it. ``task.command`` for a task.
        observation_key, action_key: where they lie.
        seed: of the noise and of the worlds.

    Attributes:
        report: on the last plan; None before the first.

    Raises:
        BadInput: settings that make no sense; at a call: no belief yet, an observation that is no number, or no
            candidate with a cost.
    """

    init_key = "is_init"

    def __init__(
        self,
        simulator: Simulator,
        cost: Cost,
        belief: Distribution | None = None,
        *,
        state: Callable[[Any], TensorDict],
        bounds: Bounds,
        noise: Noise,
        horizon: int,
        samples: int = 256,
        thetas: int = 8,
        risk: Risk | None = None,
        temperature: float = 1.0,
        control_cost: float = 0.0,
        iterations: int = 1,
        command: Callable[[Tensor], Tensor] | None = None,
        observation_key: NestedKey = "observation",
        action_key: NestedKey = "action",
        seed: int = 0,
    ) -> None:
        self.in_keys, self.out_keys = [observation_key], [action_key]
        super().__init__()
        if thetas < 1 or iterations < 1:
            raise BadInput(f"{thetas} worlds, {iterations} searches a step", "both are at least 1")
        self.search = Search(
            simulator, cost, bounds, noise, risk or Mean(), horizon, samples, temperature, control_cost, command
        )
        self.thetas, self.iterations = thetas, iterations
        self.report: Report | None = None
        self._state = state
        self._like = torch.empty(0, dtype=simulator.dtype, device=simulator.device)
        self._random = generator(seed, "planner").get_state()
        self._draws = self._like.new_empty(0, len(simulator.parameters))
        self.reset()
        if belief is not None:
            self.set_belief(belief)

    def reset(self) -> None:
        """Forget the plans."""
        bounds, horizon = self.search.bounds, self.search.horizon
        self._plan = self._like.new_empty(0, horizon, bounds.number)
        self._past = self._like.new_empty(0, self._remembered(), bounds.number)

    def set_belief(self, belief: Distribution) -> None:
        """Plan for the worlds of this belief from now on.

        Raises:
            BadInput: it is over other parameters, or a dead time in it is as long as the horizon.
        """
        draw = self._generator()
        seed = int(torch.randint(2**62, (), generator=draw))
        self._random = draw.get_state()
        on = [self._like.device] if self._like.is_cuda else []
        with torch.no_grad(), torch.random.fork_rng(devices=on):
            torch.manual_seed(seed)
            draws = belief.sample((DRAWS,))
        parameters = self.search.simulator.parameters
        if draws.shape != (DRAWS, len(parameters)):
            raise BadInput(
                f"draws of the belief have {draws.shape[-1]} parameters", f"the simulator has {list(parameters.names)}"
            )
        draws = parameters.clamp(draws.to(self._like))
        self._refuse_dead_time(draws)
        self._draws = draws

    def transforms(self) -> list[Transform]:
        """For the environment: tells where episodes begin."""
        return [InitTracker(self.init_key)]

    @dispatch
    @torch.no_grad()
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the actions."""
        if not len(self._draws):
            raise BadInput("the planner has no belief yet", "give it one when it is built, or by set_belief")
        batch = tensordict.batch_size
        state = self._state(_rows(tensordict.get(self.in_keys[0]), len(batch)))
        if not all(bool(value.isfinite().all()) for value in state.values(True, True)):
            raise BadInput("the observation to plan from is not finite", "look at the environment and its sensors")
        init = tensordict.get(self.init_key, None)
        self._begin(len(state), None if init is None else init.reshape(-1).to(self._like.device))
        action = self._planned(state)
        shape = (*batch, action.shape[-1])
        return tensordict.set(self.out_keys[0], action.float().to(tensordict.device or action.device).reshape(shape))

    def _planned(self, state: TensorDict) -> Float[Tensor, "B U"]:
        """The first commands of better plans, which move on by a step."""
        draw, search = self._generator(), self.search
        theta, weights = search.risk.worlds(self._draws.cpu(), self.thetas, draw)
        theta = search.simulator.parameters.clamp(theta).to(self._like)
        begun = starts(search.simulator, theta, state, search.commands(self._past))
        for _ in range(self.iterations):
            found = search.improve(self._plan, self._past[:, -1], begun, theta, weights.to(self._like), draw)
            self._plan = found.plan
        self.report = Report(found.effective, found.cost, theta, found.without)
        self._random = draw.get_state()
        action = self._plan[:, 0]
        self._past = torch.cat((self._past[:, 1:], action[:, None]), dim=1)
        self._plan = torch.cat((self._plan[:, 1:], self._plan[:, -1:]), dim=1)
        return action

    def _begin(self, number: int, init: Bool[Tensor, " B"] | None) -> None:
        """Plans of zeros, within the bounds, where episodes begin and where the number of environments is another."""
        plan, past = (
            self.search.bounds.admit(
                part.new_zeros(number, *part.shape[1:]), part.new_zeros(number, part.shape[2]), 1.0
            )
            for part in (self._plan, self._past)
        )
        if number != len(self._plan):
            self._plan, self._past = plan, past
        elif init is not None and bool(init.any()):
            self._plan = torch.where(init[:, None, None], plan, self._plan)
            self._past = torch.where(init[:, None, None], past, self._past)

    def _generator(self) -> Generator:
        draw = torch.Generator()
        draw.set_state(self._random)
        return draw

    def _remembered(self) -> int:
        """Number of past commands that matter: what input stages of effects remember, and the last for the rates."""
        simulator = self.search.simulator
        memory = max((e.memory for e in getattr(simulator, "effects", ()) if e.has_command), default=0.0)
        return max(1, math.ceil(memory / simulator.dt - 1e-9))

    def _refuse_dead_time(self, draws: Float[Tensor, "D P"]) -> None:
        """Refuse a horizon within which a command does not act."""
        seconds = self.search.horizon * self.search.simulator.dt
        values = self.search.simulator.parameters.view(draws)
        for effect in getattr(self.search.simulator, "effects", ()):
            longest = float(values[f"{effect.key}.delay"].max()) if isinstance(effect, ActuatorDelay) else 0.0
            if longest >= seconds:
                raise BadInput(
                    f"{effect.key} of up to {longest:g} s with a horizon of {seconds:g} s",
                    f"commands would not act within it: plan more than {longest / self.search.simulator.dt:.0f} steps",
                )

    # --- checkpoints --------------------------------------------------------------------------------------------

    def get_extra_state(self) -> dict[str, Tensor]:
        """Plans, past commands, draws of the belief and random numbers; a part of :meth:`state_dict`."""
        return {"plan": self._plan, "past": self._past, "draws": self._draws, "random": self._random}

    def set_extra_state(self, state: Mapping[str, Tensor]) -> None:
        """Go on from there, bit for bit.

        Raises:
            BadInput: it is of another horizon, or of other commands or parameters.
        """
        for name, own in self.get_extra_state().items():
            if state[name].shape[1:] != own.shape[1:]:
                raise BadInput(
                    f"a saved planner's {name} has shape {tuple(state[name].shape)}",
                    f"this one's has {tuple(own.shape)}: build it as it was",
                )
        self._plan, self._past, self._draws = (state[key].to(self._like) for key in ("plan", "past", "draws"))
        self._random = state["random"].cpu()


def _rows(value: Any, dims: int) -> Any:
    """An observation with one batch dimension in the place of ``dims``."""
    if not dims:
        return value[None] if isinstance(value, Tensor) else cast(TensorDictBase, value).unsqueeze(0)
    return value.flatten(0, dims - 1)
