"""Inputs of a network: one or several keys of an observation as one row, normalised if wanted.

x = concat(o_key for key in in_keys),    then normalised if wanted (see ``normalisation``)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Float
from tensordict import NestedKey, TensorDictBase
from torch import Tensor, nn
from torchrl.data import Composite, TensorSpec

from onlinebayes.objectives.normalisation import RunningNormalization
from onlinebayes.runs import BadInput

KEYS: tuple[NestedKey, ...] = ("observation",)


class Inputs(nn.Module):
    """Several values of a world as one row (..., F), in single precision.

    Args:
        widths: key -> width, in order.
        normalise: whether rows are normalised.
        device: of the statistics.

    Attributes:
        keys: of the values, in order.
        widths: of each of them.
        width: F.
    """

    def __init__(
        self, widths: Mapping[NestedKey, int], *, normalise: bool = False, device: torch.device | str | None = None
    ) -> None:
        super().__init__()
        self.keys, self.width = list(widths), sum(widths.values())
        self.widths = dict(widths)
        self.normalisation = RunningNormalization(self.width, device=device) if normalise else None

    def forward(self, *values: Tensor) -> Float[Tensor, "*batch F"]:
        """One row of each world."""
        row = self._joined(values)
        return row if self.normalisation is None else self.normalisation(row)

    def read(self, tensordict: TensorDictBase, under: Sequence[str] = ()) -> Float[Tensor, "*batch F"]:
        """The rows of a tensordict, below ``under`` (``("next",)``).

        Raises:
            BadInput: a key is missing or has another width.
        """
        return self(*self._values(tensordict, under))

    def observe(self, tensordict: TensorDictBase) -> None:
        """Let the statistics follow a batch, where rows are normalised."""
        values = self._values(tensordict, ())
        if self.normalisation is not None:
            self.normalisation.observe(self._joined(values))

    def _values(self, tensordict: TensorDictBase, under: Sequence[str]) -> list[Tensor]:
        values = []
        for key, width in self.widths.items():
            place = key if not under else (*under, *((key,) if isinstance(key, str) else key))
            value = tensordict.get(place, None)
            if value is None:
                raise BadInput(f"the batch has no {place!r}", f"the policy was built with in_keys = {self.keys}")
            if value.shape[-1] != width:
                raise BadInput(
                    f"{place!r} is {value.shape[-1]} wide, the policy was built for {width}",
                    "build it from the specs of this environment",
                )
            values.append(value)
        return values

    @staticmethod
    def _joined(values: Sequence[Tensor]) -> Tensor:
        if len(values) == 1:
            return values[0].to(torch.float32)
        return torch.cat([value.to(torch.float32) for value in values], dim=-1)


def inputs_of(observation_spec: TensorSpec, in_keys: Sequence[NestedKey] = KEYS, *, normalise: bool = False) -> Inputs:
    """The inputs that a spec describes.

    Args:
        observation_spec: of one world: a leaf (O,) for a single key, or a Composite that holds every key.
        in_keys: what the network sees, in order.
        normalise: whether rows are normalised.

    Raises:
        BadInput: a key that the spec lacks, several keys with a leaf spec, or a leaf that is not one row.
    """
    keys = [key if isinstance(key, str) else tuple(key) for key in in_keys]
    if isinstance(observation_spec, Composite):
        known = list(observation_spec.keys(True, True))
        missing = [key for key in keys if key not in known]
        if missing:
            raise BadInput(f"in_keys has {missing[0]!r}, the observation spec has {known}", "use one of these keys")
        leaves = {key: observation_spec[key] for key in keys}
    elif len(keys) == 1:
        leaves = {keys[0]: observation_spec}
    else:
        raise BadInput(f"in_keys = {keys} with the spec of one leaf", "give the Composite that holds all of them")
    for key, leaf in leaves.items():
        if leaf.ndim != 1:
            raise BadInput(
                f"the spec of {key!r} has shape {tuple(leaf.shape)}",
                "give the spec of one world, shape (O,): env.observation_spec_unbatched, flattened if need be",
            )
    return Inputs(
        {key: leaf.shape[0] for key, leaf in leaves.items()}, normalise=normalise, device=observation_spec.device
    )


def selected(data: TensorDictBase, keys: Sequence[NestedKey]) -> TensorDictBase:
    """The entries of a collector's batch that an objective learns from, all of them finite numbers.

    Raises:
        BadInput: one is missing, or holds a value that is NaN or infinite in single precision.
    """
    there = set(data.keys(True, True))
    missing = [key for key in keys if key not in there]
    if missing:
        raise BadInput(
            f"the batch has no {missing[0]!r}, which the objective learns from",
            "collect it with the objective's own policy in an environment that has this key",
        )
    chosen = data.select(*dict.fromkeys(keys))
    refuse_nonfinite(chosen)
    return chosen


def after(key: NestedKey) -> tuple[str, ...]:
    """The key after the step, below ``"next"``."""
    return ("next", *((key,) if isinstance(key, str) else key))


def refuse_nonfinite(data: TensorDictBase) -> None:
    """Refuse a batch with values that are no finite numbers in single precision, in which networks learn.

    A sum is finite only if all its terms are: one reduction of each key, and one answer that is waited for.

    Raises:
        BadInput: there are some.
    """
    values = {key: value for key, value in data.items(True, True) if value.is_floating_point()}
    if not values or torch.stack([value.sum(dtype=torch.float32) for value in values.values()]).isfinite().all():
        return
    for key, value in values.items():
        bad = ~value.to(torch.float32).isfinite()
        if bad.any():
            worlds = bad.reshape(len(value), -1).any(-1).nonzero().flatten().tolist()
            raise BadInput(
                f"{key!r} is NaN or infinite in {len(worlds)} of the batch's {len(value)} rows, first in {worlds[0]}",
                "find the world that diverged: bound its parameters or actions, or take a finer step",
            )
