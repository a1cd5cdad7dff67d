"""Bijections of the unit cube that depend on a context: the layers of a normalising flow, by zuko.

    u = T(z; c),    z, u in [0, 1]^P,    log |det du / dz|

| kind | layers                                                                                              |
|------|-----------------------------------------------------------------------------------------------------|
| nsf  | monotonic rational-quadratic splines of the cube itself (Durkan, Bekasov, Murray, Papamakarios 2019)  |
| maf  | y = Phi^-1(z), affine layers of R^P (Papamakarios, Pavlakou, Murray 2017), u = Phi(.)                 |

Layers are autoregressive, in turns forwards and backwards through the parameters. The splines have free slopes at both
ends, which neural spline flows usually hold at 1: an edge of the cube is a place like any other. Affine layers send an
edge to infinity, where they cannot learn: a density that leans on an edge they get wrong next to it. With one parameter
they make nothing but a Gaussian of y.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.distributions import Transform, constraints

from onlinebayes.runs import BadInput

Kind = Literal["nsf", "maf"]

EDGE = 1e-5
"""Strip along every side in which a density is constant [widths of the cube]: what single precision tells apart.

The splines lose nothing by it. Affine layers that heap up a density at an edge may put a percent of it in there."""

SLOPE = 1e-3
"""Zuko's bound on how unlike a spline's bins are, and on the factor of a slope beside them: peaks of three layers are
as sharp as single precision can tell."""


class UnitBijection(nn.Module):
    """T(z; c).

    Args:
        kind: see the module.
        size: number P of parameters.
        context: length C of the context.
        layers: number of autoregressive layers.
        hidden: width of each layer's own network, which has one hidden layer.
        bins: of a spline.

    Attributes:
        settings: these arguments, for a checkpoint.

    Raises:
        BadInput: another kind, or zuko is not installed.
    """

    def __init__(self, kind: Kind, size: int, context: int, *, layers: int, hidden: int, bins: int) -> None:
        super().__init__()
        zuko = _zuko()
        self.settings: dict[str, Any] = {
            "kind": kind,
            "size": size,
            "context": context,
            "layers": layers,
            "hidden": hidden,
            "bins": bins,
        }
        self.kind = kind
        forms: dict[str, dict[str, Any]] = {
            "nsf": {
                "univariate": partial(_CubeSpline, zuko.transforms.MonotonicRQSTransform),
                "shapes": [(bins,), (bins,), (bins + 1,)],
            },
            "maf": {},
        }
        if kind not in forms:
            raise BadInput(f"a flow of kind {kind!r}", f"known: {', '.join(forms)}")
        order = torch.arange(size)
        self.layers = zuko.lazy.LazyComposedTransform(
            *(
                zuko.flows.MaskedAutoregressiveTransform(
                    size,
                    context,
                    order=order.flip(0) if i % 2 else order,
                    hidden_features=(hidden,),
                    activation=nn.SiLU,
                    **forms[kind],
                )
                for i in range(layers)
            )
        )

    def log_abs_det(self, z: Float[Tensor, "*shape P"], context: Float[Tensor, "*batch C"]) -> Float[Tensor, "*shape"]:
        """log |det du / dz|; ``context`` broadcasts to the shape of ``z``."""
        z, layers = _inside(z), self.layers(context)
        if self.kind == "nsf":
            return layers.call_and_ladj(2 * z - 1)[1]
        y = torch.special.ndtri(z)
        x, log_abs_det = layers.call_and_ladj(y)
        return log_abs_det + 0.5 * (y.square() - x.square()).sum(-1)

    def inverse(self, u: Float[Tensor, "*shape P"], context: Float[Tensor, "*batch C"]) -> Float[Tensor, "*shape P"]:
        """z of u; ``context`` broadcasts to the shape of ``u``."""
        u, layers = _inside(u), self.layers(context)
        if self.kind == "nsf":
            return ((layers.inv(2 * u - 1) + 1) / 2).clamp(0, 1)
        return torch.special.ndtr(layers.inv(torch.special.ndtri(u)))

    @classmethod
    def restored(cls, settings: Mapping[str, Any], weights: Mapping[str, Tensor]) -> UnitBijection:
        """The bijection with these settings and weights, frozen; no random number is used up."""
        with torch.random.fork_rng(devices=[]):
            made = cls(**settings)
        made.to(next(value for value in weights.values() if value.is_floating_point()))
        made.load_state_dict(dict(weights))
        return made.requires_grad_(False)


class _CubeSpline(Transform):
    """A rational-quadratic spline of [-1, 1] onto itself with K bins and K + 1 free slopes."""

    domain = constraints.real
    codomain = constraints.real
    bijective = True
    sign = +1

    def __init__(self, spline: Any, widths: Tensor, heights: Tensor, slopes: Tensor) -> None:
        super().__init__()
        self._spline = spline(widths, heights, slopes[..., 1:-1], bound=1.0, slope=SLOPE)
        # zuko's slopes at the knots do not follow its bins, and are 1 at both ends: a spike on every edge of the cube
        # where hardly a simulation lies to say otherwise. Here a slope is that of the bins beside it, times a factor.
        steep = torch.log(self._spline.vertical.diff(dim=-1) / self._spline.horizontal.diff(dim=-1))
        beside = (torch.cat([steep[..., :1], steep], -1) + torch.cat([steep, steep[..., -1:]], -1)) / 2
        self._spline.derivatives = torch.exp(beside + slopes / (1 + torch.abs(slopes / math.log(SLOPE))))

    # On and outside the end knots zuko's spline is the identity: rounding must not get there.
    def _call(self, x: Tensor) -> Tensor:
        return self._spline(x.clamp(2 * EDGE - 1, 1 - 2 * EDGE))

    def _inverse(self, y: Tensor) -> Tensor:
        return self._spline.inv(y.clamp(2 * EDGE - 1, 1 - 2 * EDGE))

    def call_and_ladj(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Value and log slope, as zuko's transforms give them together."""
        return self._spline.call_and_ladj(x.clamp(2 * EDGE - 1, 1 - 2 * EDGE))


def _inside(z: Tensor) -> Tensor:
    return z.clamp(EDGE, 1 - EDGE)


def _zuko() -> Any:
    """The library, an optional one."""
    try:
        import zuko
    except ImportError:
        raise BadInput("flows need zuko", "install it: pip install 'onlinebayes[flows]'") from None
    return zuko
