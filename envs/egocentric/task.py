"""A task: choose in each second the sensor to ask, the cheap one or the camera.

    r(motion) = 1 if it is right, else -1
    r(vision) = 1 + l   vision right, motion wrong
                l       both right
               -1 - l   vision wrong, motion right
               -1       both wrong                                    (thesis, Eq 3.1; l its trade-off lambda)
    reward = r - price x charge used [mAh]

An episode plays one stretch of a recorded sequence, second by second; a stretch may be short, and ends the episode. The
camera's answers are emulated: vision is right with the rate that recorded predictions show for the activity. At l = 1
the difference of the two rewards is three times the gain in accuracy, so that a price then buys accuracy with charge.

The price is drawn in units of what a second of the phone's camera costs, ``cost`` = price x i_camera x 1 s.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from jaxtyping import Bool, Float, Int
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Categorical

from envs.egocentric.phone import CAPACITY, HOUR
from envs.egocentric.recorded import VISION
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Task


@dataclass(frozen=True)
class Stretches:
    """E stretches of sequences, padded with zeros at their ends: what episodes are made of.

    Attributes:
        features: what the policy sees of each second.
        motion_right: whether the motion predictor is right there.
        vision_rate: how often vision is right there.
        length: seconds of each stretch.
        sequence: the sequence that it was cut from.
    """

    features: Float[Tensor, "E T F"]
    motion_right: Bool[Tensor, "E T"]
    vision_rate: Float[Tensor, "E T"]
    length: Int[Tensor, " E"]
    sequence: Int[Tensor, " E"]

    def __post_init__(self) -> None:
        if not len(self.length) or int(self.length.min()) < 1 or int(self.length.max()) > self.features.shape[1]:
            raise BadInput(
                f"lengths {self.length.unique().tolist()} of stretches of {self.features.shape[1]} seconds",
                "give one stretch at least, each of one second at least, padded to one length",
            )

    @property
    def there(self) -> Bool[Tensor, "E T"]:
        """True where a second is not padding."""
        return torch.arange(self.features.shape[1], device=self.length.device) < self.length[:, None]

    def to(self, device: torch.device | str) -> Stretches:
        """The same on another device."""
        return Stretches(**{field.name: getattr(self, field.name).to(device) for field in fields(self)})


def gain(outcomes: Float[Tensor, "*batch 4"], trade_off: Tensor | float) -> Float[Tensor, "*batch"]:
    """Expected r(vision) - r(motion) from the probabilities of (both wrong, vision right, motion right, both right)."""
    _, vision, motion, both = outcomes.unbind(-1)
    return (2 + trade_off) * (vision - motion) - (1 - trade_off) * both


class SensorChoice(Task):
    """The observation is the second's features, lambda and the price; action 0 asks the motion sensors, 1 the camera.

    Args:
        stretches: from which each episode draws one; on the device of the phones.
        trade_off: lambda of an episode is uniform between these.
        cost: what a second of camera costs, uniform between these [reward].
    """

    def __init__(
        self,
        stretches: Stretches,
        trade_off: tuple[float, float] = (0.0, 1.0),
        cost: tuple[float, float] = (0.0, 2.0),
    ) -> None:
        self.stretches, self.trade_off, self.cost = stretches, trade_off, cost
        self.horizon = stretches.features.shape[1]
        self.observation_sizes = {"observation": stretches.features.shape[-1] + 1, "price": 1}
        self.observation_size = stretches.features.shape[-1] + 1
        self.action_spec = Categorical(2, dtype=torch.int64)

    def start(self, theta: Float[Tensor, "n P"], generator: torch.Generator) -> TensorDict:
        """A full battery; under ``"task"`` the stretch, the camera's answers in it, lambda and the price [1/mAh]."""
        n = len(theta)
        stretch = torch.randint(len(self.stretches.length), (n,), generator=generator, device=theta.device)
        rate = self.stretches.vision_rate[stretch]
        right = torch.rand(rate.shape, generator=generator, device=theta.device) < rate
        low, high = torch.tensor([self.trade_off, self.cost], dtype=theta.dtype, device=theta.device).unbind(-1)
        drawn = low + (high - low) * torch.rand(n, 2, dtype=theta.dtype, generator=generator, device=theta.device)
        price = drawn[:, 1:] * HOUR / theta[:, 1:]
        told = {"stretch": stretch, "vision_right": right, "trade_off": drawn[:, :1], "price": price}
        full = torch.full((n, 1), CAPACITY, dtype=theta.dtype, device=theta.device)
        return TensorDict({"qpos": full, "qvel": torch.zeros_like(full), "task": told}, (n,), device=theta.device)

    def observe(self, state: TensorDictBase) -> dict[str, Tensor]:
        """Features of the second that begins, with lambda; and the price."""
        told, stretch, second = self._now(state)
        seen = self.stretches.features[stretch, second]
        row = torch.cat([seen, told.get("trade_off").to(seen)], -1).float()
        return {"observation": row, "price": told.get("price").float()}

    def command(self, action: Int[Tensor, " N"]) -> Float[Tensor, "N 1"]:
        """The camera runs for the whole second, or not."""
        return (action == VISION).double()[:, None]

    def reward(self, state: TensorDictBase, action: Int[Tensor, " N"], after: TensorDictBase) -> Float[Tensor, " N"]:
        """Eq 3.1, less what the second's charge costs."""
        told, stretch, second = self._now(state)
        motion, trade = self.stretches.motion_right[stretch, second], told.get("trade_off").squeeze(-1)
        vision = told.get("vision_right").gather(1, second[:, None]).squeeze(-1)
        seeing = torch.where(
            vision, torch.where(motion, trade, 1 + trade), torch.where(motion, -1 - trade, -torch.ones_like(trade))
        )
        r = torch.where(action == VISION, seeing, 2 * motion.to(trade) - 1)
        used = (state.get("qpos") - after.get("qpos")).squeeze(-1)
        return r - told.get("price").squeeze(-1) * used

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """The stretch is over, or the battery empty."""
        stretch = state.get(("task", "stretch"))
        over = state.get("clock").squeeze(-1).round().long() >= self.stretches.length[stretch]
        return over | (state.get("qpos").squeeze(-1) <= 0)

    def _now(self, state: TensorDictBase) -> tuple[TensorDictBase, Tensor, Tensor]:
        """Return the drawn task, the stretch, and the second that begins; at the end of a stretch its last."""
        told = state.get("task")
        second = state.get("clock").squeeze(-1).round().long().clamp(max=self.horizon - 1)
        return told, told.get("stretch"), second
