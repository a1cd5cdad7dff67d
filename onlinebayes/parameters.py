"""Named physical parameters and the vector they travel as.

A simulator with P parameters publishes a :class:`ParameterSpace`; theta is one tensor (..., P) in SI units, in the
order of the space, on the leaf ``"theta"`` of a TensorDict. The unit cube u in [0, 1]^P is the common ground of
samplers and estimators:

    linear   u = (theta - low) / (high - low)
    log      u = log(theta / low) / log(high / low)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.runs import BadInput, UnknownName, nearest


@dataclass(frozen=True)
class Parameter:
    """Physical bounds of one parameter.

    Args:
        low: smallest admissible value [``unit``].
        high: largest admissible value [``unit``], above ``low``.
        unit: SI unit, e.g. ``"kg"``; empty for a pure number.
        scale: ``"linear"``, or ``"log"`` for a positive parameter whose order of magnitude is in question.

    Raises:
        BadInput: bounds that are not finite or not in order, or a log scale that reaches zero.
    """

    low: float
    high: float
    unit: str = ""
    scale: str = "linear"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high)):
            raise BadInput(f"bounds [{self.low}, {self.high}] are not finite", "give two finite numbers")
        if not self.low < self.high:
            raise BadInput(
                f"bounds [{self.low}, {self.high}] are reversed or empty",
                "the low bound comes first and is smaller",
            )
        if self.scale not in ("linear", "log"):
            raise BadInput(f"scale '{self.scale}' is unknown", "use 'linear' or 'log'")
        if self.scale == "log" and self.low <= 0:
            raise BadInput(f"a log scale cannot start at {self.low}", "use a positive low bound or scale = 'linear'")


class ParameterSpace(Mapping[str, Parameter]):
    """An ordered set of named parameters: names <-> theta (..., P) <-> unit cube (..., P).

    Immutable. Bounds are held in float64; results take theta's dtype and device.

    Args:
        parameters: name -> :class:`Parameter`, in the order of theta's last axis.

    Attributes:
        low, high: bounds (P,), float64 [units].
        linear: no parameter is on a log scale.
    """

    def __init__(self, parameters: Mapping[str, Parameter] | None = None) -> None:
        self._parameters = dict(parameters or {})
        self.names: tuple[str, ...] = tuple(self._parameters)
        values = tuple(self._parameters.values())
        self.low = torch.tensor([p.low for p in values], dtype=torch.float64)
        self.high = torch.tensor([p.high for p in values], dtype=torch.float64)
        self._log = torch.tensor([p.scale == "log" for p in values], dtype=torch.bool)
        self.linear = not bool(self._log.any())

    def __getitem__(self, name: str) -> Parameter:
        try:
            return self._parameters[name]
        except KeyError:
            raise self._unknown(name) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._parameters)

    def __len__(self) -> int:
        return len(self._parameters)

    def __contains__(self, name: object) -> bool:
        return name in self._parameters

    def __hash__(self) -> int:
        return hash(tuple(self._parameters.items()))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ParameterSpace):
            return NotImplemented
        return tuple(self._parameters.items()) == tuple(other._parameters.items())

    def __or__(self, other: ParameterSpace) -> ParameterSpace:
        """The parameters of both spaces, these first.

        Raises:
            ValueError: a name stands in both.
        """
        if shared := set(self.names) & set(other.names):
            raise ValueError(f"parameters {sorted(shared)} stand in both spaces; give each parameter one name")
        return ParameterSpace({**self._parameters, **other._parameters})

    def __repr__(self) -> str:
        return f"ParameterSpace({self._parameters!r})"

    def index(self, name: str) -> int:
        """Position of ``name`` on theta's last axis."""
        try:
            return self.names.index(name)
        except ValueError:
            raise self._unknown(name) from None

    def replaced(self, name: str, parameter: Parameter) -> ParameterSpace:
        """The same space with other bounds for ``name``.

        Raises:
            BadInput: the name is unknown.
        """
        self.index(name)
        return ParameterSpace({**self._parameters, name: parameter})

    def subspace(self, names: Iterable[str]) -> ParameterSpace:
        """The space of some of the parameters, in the order given."""
        return ParameterSpace({name: self[name] for name in names})

    def view(self, theta: Float[Tensor, "*batch P"]) -> dict[str, Float[Tensor, "*batch"]]:
        """Name -> that parameter's column of ``theta``, sharing its memory."""
        self._check_width(theta)
        return {name: theta[..., i] for i, name in enumerate(self.names)}

    def vector(
        self,
        values: Mapping[str, float | Tensor],
        *,
        dtype: torch.dtype = torch.float64,
        device: torch.device | str = "cpu",
    ) -> Float[Tensor, "*batch P"]:
        """Theta (..., P) from one value a name; values broadcast against each other.

        Raises:
            BadInput: a name is missing or unknown.
        """
        for name in values:
            if name not in self._parameters:
                raise self._unknown(name)
        if missing := [name for name in self.names if name not in values]:
            raise BadInput(f"no value for {missing}", f"give one for each of {list(self.names)}")
        if not self.names:
            return torch.zeros(0, dtype=dtype, device=device)
        columns = [torch.as_tensor(values[name], dtype=dtype, device=device) for name in self.names]
        return torch.stack(torch.broadcast_tensors(*columns), dim=-1)

    def to_unit(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch P"]:
        """u in [0, 1]^P of theta; values outside the bounds map outside the cube, nothing is clipped.

        On a log scale theta must be positive; a value that is not gives nan.
        """
        self._check_width(theta)
        low, high, log = self._bounds(theta)
        linear = (theta - low) / (high - low)
        if self.linear:
            return linear
        positive = torch.where(log, low, torch.ones_like(low))
        ratio = torch.where(log, high / positive, torch.full_like(high, math.e))
        logarithmic = torch.log(torch.where(log, theta / positive, torch.ones_like(theta))) / torch.log(ratio)
        return torch.where(log, logarithmic, linear)

    def from_unit(self, u: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch P"]:
        """Theta of a point of the unit cube; the inverse of :meth:`to_unit`."""
        self._check_width(u)
        low, high, log = self._bounds(u)
        # lerp counts from the nearer end: u = 0 and u = 1 give the bounds exactly.
        linear = torch.lerp(low, high, u)
        if self.linear:
            return linear
        positive = torch.where(log, low, torch.ones_like(low))
        ratio = torch.where(log, high / positive, torch.ones_like(high))
        logarithmic = positive * torch.exp(torch.where(log, u, torch.zeros_like(u)) * torch.log(ratio))
        return torch.where(log, logarithmic, linear)

    def log_abs_det(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch"]:
        """log |du / dtheta|: adds to a log density on the cube to give the one on the original scale [1/units]."""
        self._check_width(theta)
        low, high, log = self._bounds(theta)
        if self.linear:
            return -torch.log(high - low).sum().expand(theta.shape[:-1])
        positive = torch.where(log, low, torch.ones_like(low))
        ratio = torch.where(log, high / positive, torch.full_like(high, math.e))
        logarithmic = -torch.log(torch.where(log, theta, torch.ones_like(theta))) - torch.log(torch.log(ratio))
        return torch.where(log, logarithmic, -torch.log(high - low).expand_as(theta)).sum(-1)

    def contains(self, theta: Float[Tensor, "*batch P"]) -> Bool[Tensor, "*batch"]:
        """Check whether every parameter lies within its bounds, edges included."""
        self._check_width(theta)
        low, high, _ = self._bounds(theta)
        return ((theta >= low) & (theta <= high)).all(-1)

    def check(self, theta: Float[Tensor, "*batch P"]) -> None:
        """Raise :class:`BadInput` naming the first value of ``theta`` that is outside its bounds or not finite."""
        self._check_width(theta)
        low, high, _ = self._bounds(theta)
        wrong = ~((theta >= low) & (theta <= high))
        if bool(wrong.any()):
            first = tuple(int(i) for i in wrong.nonzero()[0])
            name, parameter = self.names[first[-1]], self[self.names[first[-1]]]
            raise BadInput(
                f"{name} = {float(theta[first]):g} {parameter.unit}",
                f"it must lie in [{parameter.low:g}, {parameter.high:g}]: change the value or widen the bounds",
            )

    def clamp(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch P"]:
        """Theta moved to the nearest point within the bounds."""
        self._check_width(theta)
        low, high, _ = self._bounds(theta)
        return torch.clamp(theta, low, high)

    def _bounds(self, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.low.to(like), self.high.to(like), self._log.to(like.device)

    def _check_width(self, theta: Tensor) -> None:
        if theta.shape[-1] != len(self):
            raise ValueError(
                f"theta has {theta.shape[-1]} columns, the space has {len(self)} parameters: {', '.join(self.names)}"
            )

    def _unknown(self, name: str) -> UnknownName:
        return UnknownName(f"parameter '{name}' is unknown", nearest(name, self.names))
