"""Input features of an embedding for one transition (o, a, o'): the inputs decide how sharp a posterior can be.

    d = o' - o                     what changed
    f = [o, a, d, a x d, r, a x r] a x d: every product of an action with a difference
    r = o' - g(o, a; theta_0)      residual against a reference simulator g, where one is given
    z = squash((f - mean) / sd)    squash(x) = sign(x) log(1 + |x|), so that outliers stay readable

On CartPole 50 raw steps carry 2.3 nats about (length, mass), with the differences 3.3 and with the products 7.2; on
Pendulum only the residual against a simulator at the proposal's centre makes the parameters visible. The products are
the statistics of BayesSim (Ramos, Possas and Fox 2019, section IV-C), here one step at a time instead of averaged.

A reference that also answers at displaced parameters gives the sensitivities J_p = (g(theta_0 + h_p) - g(theta_0 -
h_p)) / 2, and with them the two sums of a least-squares step, W = 1 / E[r^2]:

    s_p = J_p W r,    H_pq = J_p W J_q
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from onlinebayes.runs import BadInput

Reference = Callable[[Tensor, Tensor], Tensor]
"""(observation (..., O), action (..., A)) -> next observations (R, ..., O) that a reference simulator gives.

R = 1: at the centre theta_0 of the proposal. R = 1 + 2 P: there, and at theta_0 + h_1, theta_0 - h_1, theta_0 + h_2,
... with a step h_p in each parameter; see ``SimulatorReference``."""


class TransitionFeatures(nn.Module):
    """Standardised features of single transitions.

    Means, standard deviations and W are buffers, set by :meth:`fit` on the trajectories of one round of simulations;
    before that nothing is shifted or scaled. A feature that does not vary is left at zero.

    Args:
        observation: number of observed values O.
        action: number of action values A (a one-hot action has one a choice).
        products: also give the products of the action with the differences, A * O values.
        squash: pass the standardised features through sign(x) log(1 + |x|).
        reference: see :data:`Reference`; it adds the residuals, with ``products`` their products with the action, and
            with ``sensitivities`` the sums of a least-squares step. It is called without gradients.
        sensitivities: number P of parameters the reference displaces; 0 where it answers at the centre only.
        view: observation -> the O values that features are made of, where the observed ones hide what matters (a
            speed that is only seen from a moving gripper); not beside a reference.

    Attributes:
        signals: number F of features f.
        sums: number S of least-squares sums, P + P (P + 1) / 2.
        size: length of a feature vector, 2 F + S: (z, standardised f, sums).

    Raises:
        ValueError: sensitivities without a reference, or a view beside one.
    """

    mean: Tensor
    sd: Tensor
    weight: Tensor

    def __init__(
        self,
        observation: int,
        action: int,
        *,
        products: bool = True,
        squash: bool = True,
        reference: Reference | None = None,
        sensitivities: int = 0,
        view: Callable[[Tensor], Tensor] | None = None,
    ) -> None:
        super().__init__()
        if view is not None and reference is not None:
            raise ValueError("a view and a reference; give one of them")
        if sensitivities and reference is None:
            raise ValueError(f"{sensitivities} sensitivities need a reference; give one, or sensitivities=0")
        self.observation, self.action, self.products, self.squash = observation, action, products, squash
        self.reference, self.sensitivities, self.view = reference, sensitivities, view
        pairs = action * observation if products else 0
        self.signals = 2 * observation + action + pairs + (observation + pairs if reference is not None else 0)
        self.sums = sensitivities + sensitivities * (sensitivities + 1) // 2
        self.size = 2 * self.signals + self.sums
        self.register_buffer("mean", torch.zeros(self.signals, dtype=torch.float64))
        self.register_buffer("sd", torch.ones(self.signals, dtype=torch.float64))
        self.register_buffer("weight", torch.ones(observation, dtype=torch.float64))

    def fit(
        self,
        observation: Float[Tensor, "*batch O"],
        action: Float[Tensor, "*batch A"],
        following: Float[Tensor, "*batch O"],
        mask: Bool[Tensor, "*batch"] | None = None,
    ) -> None:
        """Set the buffers from data; steps outside ``mask`` are not looked at."""
        keep = torch.ones_like(observation[..., 0], dtype=torch.bool) if mask is None else mask
        rows, residual, _ = self._parts(observation[keep], action[keep], following[keep])
        if not len(rows):
            raise ValueError("no step to standardise on: the mask is empty; give at least one recorded step")
        sd, mean = torch.std_mean(rows, dim=0, correction=0)
        # Relative to the size of the values: what varies by rounding alone is a constant.
        constant = sd <= 1e-9 * rows.abs().amax(0).clamp(min=1e-30)
        self.mean.copy_(mean)
        self.sd.copy_(torch.where(constant, torch.inf, sd))
        square = residual.square().mean(0)
        self.weight.copy_(torch.where(square > 1e-30, 1 / square, 0.0))

    def forward(
        self,
        observation: Float[Tensor, "*batch O"],
        action: Float[Tensor, "*batch A"],
        following: Float[Tensor, "*batch O"],
    ) -> Float[Tensor, "*batch F"]:
        """The feature vector of each transition: z, f standardised, sums; in the observation's dtype."""
        f, residual, jacobian = self._parts(observation, action, following)
        standard = (f - self.mean) / self.sd
        z = standard.sign() * standard.abs().log1p() if self.squash else standard
        weighted = jacobian * self.weight
        score = (weighted * residual.unsqueeze(-2)).sum(-1)
        row, column = torch.triu_indices(self.sensitivities, self.sensitivities, device=f.device)
        information = (weighted[..., row, :] * jacobian[..., column, :]).sum(-1)
        return torch.cat([z, standard, score, information], dim=-1).to(observation.dtype)

    def _parts(self, observation: Tensor, action: Tensor, following: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """f (..., F), r (..., O) and J (..., P, O), in float64: differences of near-equal float32 values."""
        o, a, n = observation.double(), action.double(), following.double()
        if self.view is not None:
            o, n = self.view(o), self.view(n)
        _check_widths(o, a, self.observation, self.action)
        parts = [o, a, n - o]
        residual, jacobian = torch.zeros_like(o), o.new_zeros(*o.shape[:-1], self.sensitivities, self.observation)
        if self.products:
            parts.append(_products(a, n - o))
        if self.reference is not None:
            with torch.no_grad():
                answers = self.reference(observation, action).to(o)
            expected = 1 + 2 * self.sensitivities
            if answers.shape != (expected, *o.shape):
                raise ValueError(f"the reference gave {tuple(answers.shape)}, not {(expected, *o.shape)}")
            residual = n - answers[0]
            jacobian = ((answers[1::2] - answers[2::2]) / 2).movedim(0, -2)
            parts.append(residual)
            if self.products:
                parts.append(_products(a, residual))
        return torch.cat(parts, dim=-1), residual, jacobian


class RawTransitions(nn.Module):
    """(o, a, o') side by side, for embeddings that make their own of them.

    Args:
        observation: number of observed values O.
        action: number of action values A.
    """

    def __init__(self, observation: int, action: int) -> None:
        super().__init__()
        self.observation, self.action = observation, action
        self.size = 2 * observation + action

    def fit(self, observation: Tensor, action: Tensor, following: Tensor, mask: Tensor | None = None) -> None:
        """Nothing to set."""

    def forward(
        self,
        observation: Float[Tensor, "*batch O"],
        action: Float[Tensor, "*batch A"],
        following: Float[Tensor, "*batch O"],
    ) -> Float[Tensor, "*batch F"]:
        """The rows."""
        _check_widths(observation, action, self.observation, self.action)
        return torch.cat([observation, action, following], dim=-1)


def _check_widths(observation: Tensor, action: Tensor, observations: int, actions: int) -> None:
    """Other columns than those that were asked for would be read as if they were these."""
    widths = (observation.shape[-1], action.shape[-1])
    if widths != (observations, actions):
        raise BadInput(
            f"{widths[0]} observed values and {widths[1]} action values a step",
            f"the embedding was built for {observations} and {actions}: give the same columns, a choice as one-hot",
        )


def _products(action: Tensor, change: Tensor) -> Tensor:
    return (action.unsqueeze(-1) * change.unsqueeze(-2)).flatten(-2)
