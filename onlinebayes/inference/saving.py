"""Distributions as plain values, for a checkpoint: a dictionary of tensors, numbers and strings, and back.

A tag tells which distribution it was. What is drawn after loading is what would have been drawn before.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from onlinebayes.inference.base import Belief
from onlinebayes.inference.distributions import Box, BoxUniform, FlowDensity, TruncatedMixture
from onlinebayes.inference.distributions.bijection import UnitBijection
from onlinebayes.inference.posterior import Posterior
from onlinebayes.inference.proposals import TruncatedProposal
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput


def to_state(belief: Belief) -> dict[str, Any]:
    """The distribution as plain values.

    Raises:
        TypeError: a distribution that no tag stands for.
    """
    if isinstance(belief, Posterior):
        return to_state(belief.distribution)
    if isinstance(belief, BoxUniform):
        return {"kind": "uniform", **_box(belief.box)}
    if isinstance(belief, TruncatedMixture):
        return {
            "kind": "mixture",
            "log_weights": belief.log_weights,
            "mean": belief.mean,
            "scale_tril": belief.scale_tril,
            **_box(belief.box),
        }
    if isinstance(belief, FlowDensity):
        bijection = belief.bijection
        return {
            "kind": "flow",
            "settings": bijection.settings,
            "weights": bijection.state_dict(),
            "context": belief.context,
            **_box(belief.box),
        }
    if isinstance(belief, TruncatedProposal):
        within = belief.within
        return {
            "kind": "truncated",
            "mixture": to_state(belief.mixture),
            "within": None if within is None else _box_or_belief(within),
            **belief.values(),
        }
    raise TypeError(
        f"{type(belief).__name__} cannot be saved; a uniform, a mixture, a flow or a truncated proposal can"
    )


def from_state(space: ParameterSpace, state: Mapping[str, Any]) -> Any:
    """The distribution over ``space`` that :func:`to_state` wrote down.

    Raises:
        BadInput: another number of parameters, an unknown tag, or a flow where zuko is not installed.
    """
    kind = state.get("kind")
    if kind == "truncated":
        within = state["within"]
        return TruncatedProposal.restored(
            from_state(space, state["mixture"]), None if within is None else from_state(space, within), state
        )
    if kind not in ("uniform", "mixture", "flow", "box"):
        raise BadInput(f"a saved distribution of kind {kind!r}", "known: uniform, mixture, flow, truncated")
    low, high = torch.as_tensor(state["low"]), torch.as_tensor(state["high"])
    if len(low) != len(space):
        raise BadInput(
            f"the saved distribution has {len(low)} parameters, the space {len(space)}: {', '.join(space.names)}",
            "go on with the recipe and the parameters that began the run",
        )
    box = Box(space, low, high)
    if kind == "box":
        return box
    if kind == "uniform":
        return BoxUniform(space, box)
    if kind == "flow":
        return FlowDensity(UnitBijection.restored(state["settings"], state["weights"]), state["context"], box)
    return TruncatedMixture(state["log_weights"], state["mean"], state["scale_tril"], box)


def _box(box: Box) -> dict[str, Any]:
    return {"low": box.low, "high": box.high}


def _box_or_belief(within: Any) -> dict[str, Any]:
    return {"kind": "box", **_box(within)} if isinstance(within, Box) else to_state(within)
