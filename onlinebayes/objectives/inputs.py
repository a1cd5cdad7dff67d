"""What a network sees: one or several keys of an observation as one row, normalised if wanted.

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
        width: F.
    """

    def __init__(
        self, widths: Mapping[NestedKey, int], *, normalise: bool = False, device: torch.device | str | None = None
    ) -> None:
        super().__init__()
        self.keys, self.width = list(widths), sum(widths.values())
        self._widths = dict(widths)
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
        for key, width in self._widths.items():
            place = (*under, *((key,) if isinstance(key, str) else key))
            value = tensordict.get(place, None)
            if value is None:
                raise BadInput(f"the batch has no {place}", f"the policy was built with in_keys = {self.keys}")
            if value.shape[-1] != width:
                raise BadInput(
                    f"{place} is {value.shape[-1]} wide, the policy was built for {width}",
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
        BadInput: a key that the spec lacks, or several keys with a leaf spec.
    """
    keys = [key if isinstance(key, str) else tuple(key) for key in in_keys]
    if isinstance(observation_spec, Composite):
        known = list(observation_spec.keys(True, True))
        missing = [key for key in keys if key not in known]
        if missing:
            raise BadInput(f"in_keys has {missing[0]!r}, the observation spec has {known}", "use one of these keys")
        widths = {key: observation_spec[key].shape[-1] for key in keys}
    elif len(keys) == 1:
        widths = {keys[0]: observation_spec.shape[-1]}
    else:
        raise BadInput(f"in_keys = {keys} with the spec of one leaf", "give the Composite that holds all of them")
    return Inputs(widths, normalise=normalise, device=observation_spec.device)
