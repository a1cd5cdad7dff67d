"""Likelihood of a noisy trajectory at theta, and the way to go from there: an extended Kalman filter (Kalman 1960).

    s_t+1 = f(s_t, theta, a_t),    y_t = h(s_t) + e_t,    e_t ~ N(0, R),    R = diag(r^2)
    log p(y | theta) = sum_t log N(v_t; 0, V_t)           v_t = y_t - h(predicted s_t), V_t its covariance
    score = - sum_t W_t^T V_t^-1 v_t,    information = sum_t W_t^T V_t^-1 W_t,    W_t = dv_t / dtheta

A residual of one step from a *noisy* observation drowns in that noise; a filter weighs all observations. Derivatives
are differences through the simulator; those of the gain are left out, which makes the information that of Gauss and
Newton. Trajectories of one system add: log likelihood, score and information alike.

With ``process`` > 0 the state is disturbed at every step by that many times the sensors' noise. The likelihood of a
system that is unstable in open loop has a needle for a mode; disturbed, the filter follows the measurement whatever
theta is, and the mode has a wide slope to climb (see ``likeliest``).

What the simulator's effects remember (a delay's commands on their way) is not a part of s_t: it begins at rest and goes
on with the predicted state. That is exact for what the commands alone decide.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, cast, runtime_checkable

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn

from onlinebayes.runs import heed
from onlinebayes.simulators import Simulator

LEAST = 1e-9
"""Of a state's spread: its variance at the start, at least, so that rounding leaves it positive."""

SEEN_STEP = 5e-3
"""Of a central difference of h, in spreads of the state: observations may be single precision."""

STATE_STEP = 1e-3
"""Of a difference of the state that an observation stands for, in standard deviations of the noise."""

REMEMBERED = "effects"
"""Key of what effects remember in a simulator's state."""

IMPOSSIBLE = -1e30
"""Log likelihood where the simulator diverged."""


@runtime_checkable
class Frame(Protocol):
    """The frame of z: a box's coordinates, such as those of ``onlinebayes.inference.Box``."""

    def from_frame(self, z: Tensor, /) -> Tensor:
        """Theta of z in [0, 1]^P [units]."""
        ...


class Rows(NamedTuple):
    """A batch of trajectories: the first observation, what was done, what was seen after it, which steps there are."""

    first: Float[Tensor, "B O"]
    action: Float[Tensor, "B T A"]
    following: Float[Tensor, "B T O"]
    mask: Bool[Tensor, "B T"]


class Evidence(NamedTuple):
    """The evidence of a trajectory about z.

    Attributes:
        log_likelihood: up to a constant.
        score, information: its gradient, and the curvature of Gauss and Newton.
        innovation: mean of v^2 / V over the steps, one where r is right.
    """

    log_likelihood: Float[Tensor, " B"]
    score: Float[Tensor, "B P"]
    information: Float[Tensor, "B P P"]
    innovation: Float[Tensor, "B O"]


class SimulatorFilter(nn.Module):
    """A filter through a simulator.

    Args:
        simulator: f; only its ``rollout`` is used. The filter begins where it lies.
        box: what z is.
        observation: number of observed values O.
        state: observations (M, O) -> complete states (M,), the inverse of ``observe``.
        command: actions (M, A) -> commands (M, U).
        observe: h, states (M,) -> observations (M, O).

    Attributes:
        noise: r (O,) [units of the observation].
        start_mean, start_covariance: of the first observation without its noise.
        spread: of the state's values over trajectories, for the size of differences.
    """

    noise: Tensor
    start_mean: Tensor
    start_covariance: Tensor
    spread: Tensor

    def __init__(
        self,
        simulator: Simulator,
        box: Frame,
        observation: int,
        *,
        state: Callable[[Tensor], TensorDictBase],
        command: Callable[[Tensor], Tensor],
        observe: Callable[[TensorDictBase], Any],
    ) -> None:
        super().__init__()
        self.simulator, self.box, self.observation = simulator, box, observation
        self._state, self._command, self._observe = state, command, observe
        device = simulator.device
        template = state(torch.zeros(1, observation, dtype=torch.float64, device=device)).to(device)
        self._keys = [key for key in template.keys(True, True) if cast(Tensor, template.get(key)).is_floating_point()]
        self._sizes = [cast(Tensor, template.get(key)).numel() for key in self._keys]
        self._shapes = [cast(Tensor, template.get(key)).shape[1:] for key in self._keys]
        self._others = template.exclude(*self._keys)
        self._times = torch.tensor([simulator.dt], dtype=torch.float64)
        one = torch.ones(observation, dtype=torch.float64, device=device)
        self.register_buffer("noise", 0.01 * one)
        self.register_buffer("start_mean", torch.zeros_like(one))
        self.register_buffer("start_covariance", 1e6 * torch.diag(one))
        self.register_buffer("spread", torch.ones(sum(self._sizes), dtype=torch.float64, device=device))

    def begin_at(self, first: Float[Tensor, "B O"]) -> None:
        """Set where trajectories begin, and how far states lie apart, from their first observations."""
        covariance = torch.cov(first.T).reshape(2 * first.shape[1:]) - torch.diag(self.noise.square())
        values, vectors = torch.linalg.eigh(covariance)
        least = 1e-4 * self.noise.square().amin()
        self.start_mean.copy_(first.mean(0))
        self.start_covariance.copy_((vectors * values.clamp_min(least)) @ vectors.T)

    def spread_over(self, observation: Float[Tensor, "M O"]) -> None:
        """The state's spread, read off observations."""
        sd = self._packed(self._state(observation)).std(0)
        self.spread.copy_(torch.where(sd > 1e-12, sd, torch.ones_like(sd)))

    def forward(self, rows: Rows, z: Float[Tensor, "B P"], process: Float[Tensor, " B"] | None = None) -> Evidence:
        """Compute the evidence of each trajectory at its z in [0, 1]^P, by default with an undisturbed state."""
        with torch.inference_mode():  # a fifth quicker than without gradients
            found = _Pass(self, rows, z, process, slopes=True).over()
        return Evidence(*(part.clone() for part in found))

    @torch.no_grad()
    def log_likelihood(self, rows: Rows, z: Float[Tensor, "B P"]) -> Float[Tensor, " B"]:
        """The first of the evidence alone, faster."""
        return _Pass(self, rows, z, None, slopes=False).over().log_likelihood

    def started(self, first: Tensor) -> tuple[Float[Tensor, "B S"], Float[Tensor, "B S S"], Float[Tensor, "B S S"]]:
        """State at the start, its covariance, and what the sensors' noise alone would make of it."""
        R = torch.diag(self.noise.square())
        gain = torch.linalg.solve(self.start_covariance + R, self.start_covariance).mT
        seen = self.start_mean + (first - self.start_mean) @ gain.mT
        C = self.start_covariance - gain @ self.start_covariance
        steps = STATE_STEP * self.noise
        moved = steps * torch.eye(len(steps)).to(first)[:, None]
        both = self._packed(self._state(torch.cat([seen + moved, seen - moved]).reshape(-1, first.shape[1])))
        above, below = both.reshape(2, len(steps), len(first), -1)
        G = ((above - below) / (2 * steps[:, None, None])).permute(1, 2, 0)
        least = LEAST * torch.diag(self.spread.square())
        return self._packed(self._state(seen)), G @ C @ G.mT + least, G @ R @ G.mT

    def theta(self, z: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch P"]:
        """Parameters of z, as the simulator takes them."""
        return self.box.from_frame(z).to(self.simulator.device, self.simulator.dtype)

    def stepped(
        self,
        x: Float[Tensor, "M S"],
        theta: Float[Tensor, "M P"],
        action: Float[Tensor, "M A"],
        remembered: TensorDict | None = None,
    ) -> tuple[Float[Tensor, "M S"], TensorDict | None]:
        """States after one step, and what the effects remember then; ``remembered`` before it, at rest without."""
        simulator = self.simulator
        command = self._command(action.to(simulator.dtype)).to(simulator.device, simulator.dtype)
        inputs = TensorDict({"command": command.unsqueeze(1)}, batch_size=[len(x), 1])
        state = self._unpacked(x)
        if remembered is not None:
            state.set(REMEMBERED, remembered)
        after = simulator.rollout(theta, state, inputs, self._times)[:, 0]
        return self._packed(after).to(x), after.get(REMEMBERED, None)

    def seen(self, x: Float[Tensor, "M S"]) -> Float[Tensor, "M O"]:
        """h."""
        return cast(Tensor, self._observe(self._unpacked(x))).to(x)

    def _packed(self, state: TensorDictBase) -> Tensor:
        return torch.cat([state.get(key).reshape(state.shape[0], -1) for key in self._keys], dim=1).double()

    def _unpacked(self, flat: Tensor) -> TensorDict:
        M, parts = len(flat), flat.to(self.simulator.device, self.simulator.dtype).split(self._sizes, dim=1)
        state = TensorDict({}, [M]) if self._others.is_empty() else cast(TensorDict, self._others.expand(M).clone())
        for key, shape, part in zip(self._keys, self._shapes, parts, strict=True):
            state.set(key, part.reshape(M, *shape))
        return state


class _Pass:
    """One filter over a batch of trajectories."""

    def __init__(self, of: SimulatorFilter, rows: Rows, z: Tensor, process: Tensor | None, *, slopes: bool) -> None:
        self._of, self._rows = of, rows
        self._step = float(torch.finfo(of.simulator.dtype).eps) ** 0.4
        # Differences are taken forward, and have to stay in the box.
        z = z.clamp(0, 1 - self._step)
        self._slopes = P = z.shape[1] if slopes else 0
        self._mean, self._covariance, of_noise = of.started(rows.first)
        self._disturbance = 0.0 if process is None else process.to(z).square()[:, None, None] * of_noise
        self._follows = self._mean.new_zeros(*self._mean.shape, self._slopes)  # d mean / dz
        self._remembered: TensorDict | None = None
        self._R = torch.diag(of.noise.square()).to(z)
        self._whole = bool(rows.mask.all())
        steps, shown = self._step * of.spread, SEEN_STEP * of.spread
        self._apart, self._moved = (steps, torch.diag(steps)[:, None]), (shown, torch.diag(shown)[:, None])
        # One row of z for every state that a step is taken from: the mean, it displaced, z displaced.
        S = self._mean.shape[1]
        displaced = z + self._step * torch.eye(z.shape[1]).to(z)[:P, None]
        self._theta = of.theta(torch.cat([z.expand(1 + S, *z.shape), displaced]).flatten(0, 1))

    def over(self) -> Evidence:
        """All steps."""
        rows, P = self._rows, self._slopes
        zeros = self._mean.new_zeros
        B = len(rows.first)
        total = zeros(B), zeros(B, P), zeros(B, P, P), torch.zeros_like(rows.first)
        for t in range(rows.mask.shape[1]):
            heed()
            here = rows.mask[:, t]
            parts = self._update(rows.action[:, t], rows.following[:, t], here)
            total = tuple(  # type: ignore[assignment]
                sum_ + self._where(here, part, torch.zeros_like(part)) for sum_, part in zip(total, parts, strict=True)
            )
        steps = rows.mask.sum(1, keepdim=True).clamp_min(1)
        good = torch.isfinite(total[0]) & torch.isfinite(total[1]).all(-1)
        return Evidence(
            torch.where(good, total[0], IMPOSSIBLE),
            torch.where(good[:, None], total[1], 0.0),
            torch.where(good[:, None, None], total[2], 0.0),
            (total[3] / steps).nan_to_num(nan=1e6),
        )

    def _update(self, action: Tensor, following: Tensor, here: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Predict, compare, correct; what the step adds to the evidence."""
        predicted, F, sensitivity = self._predicted(action)
        C = F @ self._covariance @ F.mT + self._disturbance
        shown, H = self._shown(predicted)
        v = following - shown
        V = H @ C @ H.mT + self._R
        lower, failed = torch.linalg.cholesky_ex(V)
        D = F @ self._follows + sensitivity
        solved = torch.linalg.solve_triangular(lower, torch.cat([v[..., None], H @ C, H @ D], -1), upper=False)
        w, HC, W = solved.split([1, C.shape[-1], self._slopes], dim=-1)
        gain = torch.linalg.solve_triangular(lower.mT, HC, upper=True).mT
        C = C - HC.mT @ HC
        self._mean = self._where(here, predicted + (gain @ v[..., None])[..., 0], self._mean)
        self._covariance = self._where(here, 0.5 * (C + C.mT), self._covariance)
        self._follows = self._where(here, D - gain @ (H @ D), self._follows)
        volume = torch.diagonal(lower, dim1=-2, dim2=-1).log().sum(-1)
        value = torch.where(failed == 0, -0.5 * w.square().sum((-2, -1)) - volume, torch.nan)
        return value, (W.mT @ w)[..., 0], W.mT @ W, v.square() / torch.diagonal(V, dim1=-2, dim2=-1)

    def _where(self, here: Tensor, new: Tensor, old: Tensor) -> Tensor:
        """The new value of each trajectory that has this step, the old one of the others."""
        return new if self._whole else torch.where(here.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    def _predicted(self, action: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """f, df/ds and df/dz."""
        x, P = self._mean, self._slopes
        B, S = x.shape
        steps, moved = self._apart
        states = torch.cat([x[None], x + moved, x.expand(P, B, S)]).flatten(0, 1)
        found, remembered = self._of.stepped(states, self._theta, action.repeat(1 + S + P, 1), self._remembered)
        self._remembered = remembered
        after = found.reshape(-1, B, S)
        change = (after[1:] - after[0]).movedim(0, -1)
        return after[0], change[..., :S] / steps, change[..., S:] / self._step

    def _shown(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """h and dh/ds."""
        B, S = x.shape
        steps, moved = self._moved
        shown = self._of.seen(torch.cat([x[None], x + moved, x - moved]).reshape(-1, S)).reshape(1 + 2 * S, B, -1)
        return shown[0], ((shown[1 : 1 + S] - shown[1 + S :]) / (2 * steps[:, None, None])).movedim(0, -1)
