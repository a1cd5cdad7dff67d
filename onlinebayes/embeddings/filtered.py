"""What a trajectory says of theta under sensor noise: an extended Kalman filter over state and parameters at once.

    s_t+1 = f(s_t, theta, a_t),    theta_t+1 = theta_t,    y_t = h(s_t) + e_t,   e_t ~ N(0, diag(r^2))
    e(x) = [z, log diag(L), L / diag(L) below it, log innovations^2 / expected],       Sigma = L L^T

z and Sigma are the filter's mean and covariance of theta at the end, in the coordinates of a box. A residual of one
step from a *noisy* observation drowns in that noise; a filter weighs all observations (Kalman 1960; parameters as
states: Cox 1964). Derivatives are differences through the simulator. The filter runs several times, each time with a
flat belief about where the last pass ended, so that z is the most likely theta and no prior draws at it.

Nothing of this needs to be right: the estimator learns from simulations what z and Sigma mean. The noise r is read off
the simulations by :meth:`fit`, so that normalised innovations have mean square one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol, cast, runtime_checkable

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings.base import Embedding, check_padding
from onlinebayes.embeddings.features import RawTransitions
from onlinebayes.embeddings.standard import Standard
from onlinebayes.simulators import Simulator

PASSES = 3
"""Where the last one ended is no better a place to linearise after the third."""

FLAT = 0.5
"""Standard deviation of theta before the first row, in widths of the box."""

STEP = 1e-5
"""Of a difference, in widths of the box and in standard deviations of an observation."""

FIRST_NOISE = 0.03
"""Of an observation's standard deviation: where the search for r begins."""

LEAST_NOISE = 1e-5
"""The same, at least: simulations without noise would ask for none."""

NOISE_ROUNDS = 4
"""Of that search: a factor of ten is found in three."""


@runtime_checkable
class Frame(Protocol):
    """What z is: a box's coordinates, such as those of ``onlinebayes.inference.Box``."""

    def from_frame(self, z: Tensor, /) -> Tensor:
        """Theta of z in [0, 1]^P [units]."""
        ...


class FilteredEmbedding(Embedding):
    """Trajectory -> the estimate of theta that a filter makes of it, and how sure it is.

    Args:
        simulator: f; only its ``rollout`` is used.
        box: of the proposal.
        observation, action: numbers of values O and A.
        state: observations (M, O) -> complete states (M,), the inverse of ``observe``.
        command: actions (M, A) -> commands (M, U).
        observe: h, states (M,) -> observations (M, O).
    """

    noise: Tensor
    scale_of: Tensor

    def __init__(
        self,
        simulator: Simulator,
        box: Frame,
        observation: int,
        action: int,
        *,
        state: Callable[[Tensor], TensorDictBase],
        command: Callable[[Tensor], Tensor],
        observe: Callable[[TensorDictBase], Any],
    ) -> None:
        super().__init__(RawTransitions(observation, action))
        self.simulator, self.box = simulator, box
        self._state, self._command, self._observe = state, command, observe
        self._observation, self._action = observation, action
        P = len(simulator.parameters)
        self.size = 2 * P + P * (P - 1) // 2 + observation
        one = torch.ones(observation, dtype=torch.float64)
        self.register_buffer("noise", FIRST_NOISE * one)
        self.register_buffer("scale_of", one.clone())
        self.standard = Standard(self.size)

    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Find the noise, then the mean and spread of what the filter gives."""
        seen = features[..., : self._observation].double()[mask]
        self.scale_of.copy_(seen.std(0).clamp_min(1e-12))
        self.noise.copy_(FIRST_NOISE * self.scale_of)
        some = slice(0, 200)
        for _ in range(NOISE_ROUNDS):
            ratio = self._filtered(features[some], mask[some])[2].median(0).values
            self.noise.copy_((self.noise * ratio.sqrt()).clamp_min(LEAST_NOISE * self.scale_of))
        x = self._raw(features, mask)
        self.standard.fit(x)

    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
        """Embed trajectories made into rows before; see :meth:`Embedding.encode`."""
        check_padding(mask)
        vector = self.standard(self._raw(features, mask)).to(features.dtype)
        return torch.where(mask.any(1, keepdim=True), vector, torch.zeros_like(vector))

    def _raw(self, features: Tensor, mask: Tensor) -> Float[Tensor, "B E"]:
        z, covariance, ratio = self._filtered(features, mask)
        lower = torch.linalg.cholesky(covariance)
        diagonal = torch.diagonal(lower, dim1=-2, dim2=-1)
        row, column = torch.tril_indices(covariance.shape[-1], covariance.shape[-1], offset=-1)
        shear = lower[:, row, column] / diagonal[:, row]
        return torch.cat([z, diagonal.log(), shear, ratio.clamp_min(1e-12).log()], dim=-1)

    @torch.no_grad()
    def _filtered(
        self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]
    ) -> tuple[Float[Tensor, "B P"], Float[Tensor, "B P P"], Float[Tensor, "B O"]]:
        """Mean and covariance of z after the last pass, and the mean square of its normalised innovations."""
        rows = features.double()
        first = rows[:, 0, : self._observation]
        action = rows[..., self._observation : -self._observation]
        following = rows[..., -self._observation :]
        P = len(self.simulator.parameters)
        z = rows.new_full((len(rows), P), 0.5)
        run = _Filter(self, first, action, following, mask)
        for _ in range(PASSES):
            z, covariance, ratio = run.over(z.clamp(0, 1))
        return z, covariance, ratio


class _Filter:
    """One filter over a batch of trajectories.

    Args:
        of: the embedding.
        first: observation at the start (B, O).
        action, following: what was done, and seen after it (B, T, A), (B, T, O).
        mask: which steps there are (B, T).
    """

    def __init__(self, of: FilteredEmbedding, first: Tensor, action: Tensor, following: Tensor, mask: Tensor) -> None:
        self._of, self._first, self._action, self._following, self._mask = of, first, action, following, mask
        start = of._state(first)
        self._template = start
        self._keys = [key for key in start.keys(True, True) if cast(Tensor, start.get(key)).is_floating_point()]
        self._sizes = [cast(Tensor, start.get(key)).reshape(len(first), -1).shape[1] for key in self._keys]
        self._noise = of.noise.to(first).square()

    def over(self, z: Float[Tensor, "B P"]) -> tuple[Tensor, Tensor, Tensor]:
        """Belief of z after a pass that began at z with a flat belief, and the normalised innovations."""
        mean, covariance = self._begun(z)
        total, count = torch.zeros_like(self._first), self._mask.sum(1, keepdim=True).clamp_min(1)
        for t in range(self._action.shape[1]):
            # Beyond its bounds theta goes on as it does at them: a clipped estimate would pass for a sure one.
            inside = self._inside(mean)
            mean_after, F = self._jacobian(inside, partial(self._stepped, action=self._action[:, t]))
            mean_after = mean_after + (F @ (mean - inside)[..., None])[..., 0]
            predicted = F @ covariance @ F.mT
            shown, H = self._jacobian(mean_after, self._seen)
            expected = H @ predicted @ H.mT + torch.diag_embed(self._noise.expand_as(shown))
            innovation = self._following[:, t] - shown
            gain = torch.linalg.solve(expected, H @ predicted).mT
            moved = mean_after + (gain @ innovation[..., None])[..., 0]
            kept = torch.eye(mean.shape[1]).to(mean) - gain @ H
            # Joseph's form stays positive where rounding would not.
            after = kept @ predicted @ kept.mT + gain @ torch.diag_embed(self._noise.expand_as(shown)) @ gain.mT
            here = self._mask[:, t, None]
            good = here & torch.isfinite(moved).all(1, keepdim=True)
            mean = torch.where(good, moved, mean)
            covariance = torch.where(good[..., None], 0.5 * (after + after.mT), covariance)
            square = innovation.square() / torch.diagonal(expected, dim1=-2, dim2=-1)
            total = total + torch.where(good, square, torch.zeros_like(square))
        P = z.shape[1]
        floor = 1e-12 * torch.eye(P).to(mean)
        return mean[:, -P:], covariance[:, -P:, -P:] + floor, total / count

    def _begun(self, z: Tensor) -> tuple[Tensor, Tensor]:
        """State off the first observation, its covariance from the noise there, theta flat."""
        start = self._packed(self._of._state(self._first))
        steps = STEP * self._of.scale_of.to(start)
        columns = [
            (self._packed(self._of._state(self._first + step * axis)) - start) / step
            for step, axis in zip(steps, torch.eye(len(steps)).to(start), strict=True)
        ]
        G = torch.stack(columns, dim=-1)
        P, S = z.shape[1], start.shape[1]
        covariance = start.new_zeros(len(start), S + P, S + P)
        covariance[:, :S, :S] = G @ torch.diag(self._noise) @ G.mT + 1e-10 * torch.eye(S).to(start)
        covariance[:, S:, S:] = FLAT**2 * torch.eye(P).to(start)
        return torch.cat([start, z], dim=1), covariance

    def _jacobian(
        self, x: Float[Tensor, "B m"], of: Callable[[Float[Tensor, "K B m"]], Tensor]
    ) -> tuple[Float[Tensor, "B n"], Float[Tensor, "B n m"]]:
        """Value and derivatives by central differences, all in one batch."""
        m = x.shape[1]
        move = STEP * torch.eye(m).to(x)[:, None]
        values = of(torch.cat([x[None], x + move, x - move]))
        return values[0], ((values[1 : 1 + m] - values[1 + m :]) / (2 * STEP)).movedim(0, -1)

    def _stepped(self, x: Float[Tensor, "K B m"], action: Float[Tensor, "B A"]) -> Float[Tensor, "K B m"]:
        of, K, B = self._of, *x.shape[:2]
        S = sum(self._sizes)
        flat = x.reshape(K * B, -1)
        theta, simulator = of.box.from_frame(flat[:, S:]), of.simulator
        command = of._command(action.to(simulator.dtype)).to(simulator.device, simulator.dtype)
        inputs = TensorDict({"command": command.repeat(K, 1).unsqueeze(1)}, batch_size=[K * B, 1])
        times = torch.tensor([simulator.dt], dtype=torch.float64)
        state = self._unpacked(flat[:, :S], K)
        after = simulator.rollout(theta.to(simulator.device, simulator.dtype), state, inputs, times)[:, 0]
        return torch.cat([self._packed(after).to(flat), flat[:, S:]], dim=1).reshape(K, B, -1)

    def _seen(self, x: Float[Tensor, "K B m"]) -> Float[Tensor, "K B O"]:
        K, B = x.shape[:2]
        state = self._unpacked(x.reshape(K * B, -1)[:, : sum(self._sizes)], K)
        return self._of._observe(state).to(x).reshape(K, B, -1)

    def _inside(self, x: Float[Tensor, "B m"]) -> Float[Tensor, "B m"]:
        """With z inside the box by so much that differences stay in it."""
        S = sum(self._sizes)
        return torch.cat([x[:, :S], x[:, S:].clamp(2 * STEP, 1 - 2 * STEP)], dim=1)

    def _packed(self, state: TensorDictBase) -> Tensor:
        return torch.cat([state.get(key).reshape(state.shape[0], -1) for key in self._keys], dim=1).double()

    def _unpacked(self, flat: Tensor, copies: int) -> TensorDict:
        template, simulator = self._template, self._of.simulator
        state = cast(TensorDict, torch.cat([template] * copies))
        for key, part in zip(self._keys, flat.split(self._sizes, dim=1), strict=True):
            state.set(key, part.to(simulator.device, simulator.dtype).reshape(state.get(key).shape))
        return state
