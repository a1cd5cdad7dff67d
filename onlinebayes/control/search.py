r"""One step of path-integral control: candidates about a plan, tried in several worlds, averaged by their costs.

    v_s = admissible(u + e_s),     e_s = sd F z_s,     e_1 = 0
    J_s = R_k [ sum_t c(x_t^{ks}, v_t^s, x_{t+1}^{ks}) ] + gamma u^T Sigma^+ e_s,     Sigma = sd^2 F F^T
    w_s = exp(-J_s / lambda) / sum_s exp(-J_s / lambda),     u <- sum_s w_s v_s,     n_eff = 1 / sum_s w_s^2

Williams et al. 2017, Information Theoretic MPC for Model-Based Reinforcement Learning; over a distribution of theta:
Barcelos et al. 2020, DISCO: Double Likelihood-free Inference Stochastic Control, and section 5.4.3 of the thesis.

| term                            | code                 |
|---------------------------------|----------------------|
| v_s                             | ``Bounds.admit``     |
| x^{ks}                          | ``rollouts``         |
| R_k over the worlds theta_k     | ``Risk.over``        |
| gamma u^T Sigma^+ e_s           | :meth:`Search._kept` |
| w_s, n_eff                      | :func:`averaged`     |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDictBase
from torch import Generator, Tensor

from onlinebayes.control.bounds import Bounds
from onlinebayes.control.cost import Cost
from onlinebayes.control.noise import Noise
from onlinebayes.control.risk import Risk
from onlinebayes.control.rollouts import crossed, rolled_out
from onlinebayes.runs import BadInput, heed
from onlinebayes.simulators import Simulator

AT_ONCE = 2**21
"""Simulated steps in one batch, over starts, worlds and candidates together: bounds memory."""


class Found(NamedTuple):
    """Result of one step for B starts.

    Attributes:
        plan: commands (B, H, U).
        cost: mean cost of the candidates by their weights (B,).
        effective: number of candidates that carry the mean, from 1 to S (B,).
        without: rollouts of each world that have no cost (B, K).
    """

    plan: Tensor
    cost: Tensor
    effective: Tensor
    without: Tensor


@dataclass(frozen=True, eq=False)
class Search:
    """Holds no state of its own: copies share it.

    Args:
        simulator: whose ``rollout`` is used; its worlds stay as they are.
        cost: of every step.
        bounds: of the commands that are planned.
        noise: of the candidates.
        risk: which worlds, and how their costs become one.
        horizon: steps H.
        samples: candidates S.
        temperature: lambda [units of the cost]; the smaller, the fewer candidates count.
        control_cost: gamma [units of the cost]; holds plans near zero. lambda (1 - alpha) in Williams's paper.
        command: actions (N, U) -> the simulator's commands; the same without it.
    """

    simulator: Simulator
    cost: Cost
    bounds: Bounds
    noise: Noise
    risk: Risk
    horizon: int
    samples: int
    temperature: float
    control_cost: float
    command: Callable[[Tensor], Tensor] | None = None

    def __post_init__(self) -> None:
        if self.horizon < 1 or self.samples < 2:
            raise BadInput(f"{self.samples} candidates of {self.horizon} steps", "needs samples >= 2 and horizon >= 1")
        if not self.temperature > 0 or not self.control_cost >= 0:
            raise BadInput(
                f"temperature {self.temperature:g}, control cost {self.control_cost:g}",
                "needs temperature > 0 and control cost >= 0, both in units of the cost",
            )
        if torch.as_tensor(self.noise.sd).numel() not in (1, self.bounds.number):
            raise BadInput(f"noise with sd {self.noise.sd}", f"give one for all or {self.bounds.number}, one a command")

    def __deepcopy__(self, memo: dict[int, Any]) -> Search:
        return self

    def improve(
        self,
        plan: Float[Tensor, "B H U"],
        last: Float[Tensor, "B U"],
        state: TensorDictBase,
        theta: Float[Tensor, "K P"],
        weights: Float[Tensor, " K"],
        generator: Generator,
    ) -> Found:
        """A better plan for each of B starts; all of them try the same noise in the same worlds.

        Args:
            plan: the present ones.
            last: the commands before their first step.
            state: where they start in each world (B, K).
            theta, weights: the worlds and their weights.
            generator: of the noise.

        Raises:
            BadInput: no candidate has a cost in any world.
        """
        S, H, U = self.samples, self.horizon, self.bounds.number
        factor = self._factor.to(plan)
        z = torch.randn(S, U, factor.shape[1], generator=generator, dtype=plan.dtype).to(plan.device)
        z[0] = 0  # the plan as it stands is a candidate
        sd = torch.as_tensor(self.noise.sd).to(plan).expand(U)
        noise = (z @ factor.T).mT * sd
        size = max(1, AT_ONCE // (len(theta) * S * H))
        found = []
        for begin in range(0, len(plan), size):
            heed()
            rows = slice(begin, begin + size) if size < len(plan) else ...
            tried = self.bounds.admit(plan[rows][:, None] + noise, last[rows][:, None], self.simulator.dt)
            costs = self._costs(tried, state if rows is ... else state[rows], theta)
            total, admitted = self._risked(costs, weights)
            if self.control_cost:
                total = total + self._kept(plan[rows], z / sd[:, None])
            found.append(Found(*averaged(tried, total, admitted, self.temperature), (~costs.isfinite()).sum(-1)))
        return Found(*(torch.cat(part) for part in zip(*found, strict=True)))

    @cached_property
    def _factor(self) -> Float[Tensor, "H n"]:
        return self.noise.factor(self.horizon)

    def commands(self, actions: Float[Tensor, "M H A"]) -> Float[Tensor, "M H U"]:
        """The simulator's commands for actions."""
        if self.command is None:
            return actions
        return self.command(actions.flatten(0, 1)).unflatten(0, actions.shape[:2])

    def _costs(
        self, tried: Float[Tensor, "B S H U"], state: TensorDictBase, theta: Float[Tensor, "K P"]
    ) -> Float[Tensor, "B K S"]:
        """Cost of every candidate in every world; no number where it has none or the world diverged."""
        thetas, states, actions = crossed(theta, state, tried)
        rollouts = rolled_out(self.simulator, thetas, states, self.commands(actions))
        costs = self.cost(rollouts.before, actions, rollouts.after)
        if costs.shape != actions.shape[:2]:
            raise BadInput(
                f"a cost of shape {tuple(costs.shape)}", f"give one number a step, shape {tuple(actions.shape[:2])}"
            )
        total = costs.to(tried).sum(1).masked_fill(~rollouts.valid[:, -1], torch.nan)
        return total.reshape(len(tried), len(theta), -1)

    def _risked(
        self, costs: Float[Tensor, "B K S"], weights: Float[Tensor, " K"]
    ) -> tuple[Float[Tensor, "B S"], Bool[Tensor, "B S"]]:
        """One cost a candidate, and which are compared: those that have a cost in as many worlds as any."""
        sound = costs.isfinite()
        shares = weights[:, None].expand_as(costs)
        if bool(sound.all()):
            return self.risk.over(costs, shares), torch.ones_like(sound[:, 0])
        number = sound.sum(1)
        if bool((number.amax(-1) == 0).any()):
            raise BadInput(
                "no candidate has a cost in any world of the belief",
                "look at the cost, the observation and the bounds of the parameters: rollouts diverge or give nan",
            )
        shares = torch.where(sound, shares, 0)
        shares = shares / shares.sum(1, keepdim=True).clamp(min=torch.finfo(shares.dtype).tiny)
        total = self.risk.over(torch.where(sound, costs, 0), shares)
        admitted = number == number.amax(-1, keepdim=True)
        return torch.where(admitted, total, 0), admitted

    def _kept(self, plan: Float[Tensor, "B H U"], scaled: Float[Tensor, "S U n"]) -> Float[Tensor, "B S"]:
        """gamma u^T Sigma^+ e_s, where e_s = sd F z_s and ``scaled`` is z_s / sd."""
        coordinates = torch.linalg.pinv(self._factor).to(plan) @ plan
        return self.control_cost * torch.einsum("bnu,sun->bs", coordinates, scaled)


def averaged(
    tried: Float[Tensor, "B S H U"], costs: Float[Tensor, "B S"], admitted: Bool[Tensor, "B S"], temperature: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Plan (B, H, U), its candidates' mean cost (B,) and effective number (B,)."""
    weights = torch.softmax((-costs / temperature).masked_fill(~admitted, -torch.inf), dim=-1)
    plan = (weights[:, None] @ tried.flatten(2)).unflatten(2, tried.shape[2:])[:, 0]
    return plan, (weights * costs).sum(-1), 1 / weights.square().sum(-1)
