"""A battery that has to last: how fast it empties is inferred from its log, and the camera's cost follows from that.

    share = (charge left / time left - i_motion) / i_camera           seconds of camera that the battery pays for
    the camera is asked in this share of the seconds, those in which the policy holds on to it most

The share is taken anew before each sequence, with the currents that are believed. Who believes in too small ones uses
the camera too much, and stands with an empty battery before the time is over.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor

from envs.egocentric import CURRENTS, Phone, Stretches
from envs.egocentric.battery_log import BatteryLog, charge_state
from envs.egocentric.phone import HOUR
from onlinebayes.inference import BoxUniform, PosteriorEstimator, filtered_estimator, fit
from onlinebayes.trainers import Point, Problem, trajectories
from onlinebayes.transforms import Distribution, ParameterRandomization

LOG_STEP = 60.0
"""Time between two readings of a battery's log [s]."""

LOG_STEPS = 30

SHARES = torch.linspace(0.0, 1.0, 41)
"""Of seconds with the camera, between which a battery may choose."""

GAUGE = 0.5
"""Standard deviation of a gauge's reading [mAh]."""


def log_problem() -> Problem:
    """The phone as its log shows it."""
    return Problem(Phone(dt=LOG_STEP), BatteryLog(LOG_STEPS), BoxUniform(CURRENTS), torch.tensor([GAUGE]))


def logs(problem: Problem, number: int, theta: Distribution, seed: int) -> TensorDict:
    """Logs (number, T) of phones whose camera runs now and then, for some minutes."""
    generator = torch.Generator().manual_seed(seed)
    blocks = torch.rand(number, -(-LOG_STEPS // 5), generator=generator).round().repeat_interleave(5, 1)
    minutes = iter(blocks.unbind(1))
    used = TensorDictModule(lambda charge: next(minutes)[:, None], ["observation"], ["action"])
    env = problem.worlds(number, ParameterRandomization(theta), seed)
    env.set_seed(seed)
    return trajectories(env, used, LOG_STEPS)


def log_estimator(problem: Problem, simulations: int, epochs: int, seed: int) -> PosteriorEstimator:
    """The library's estimator behind a filter through the phone, fitted to simulated logs."""
    train = partial(fit, epochs=epochs, batch_size=50, learning_rate=1e-3)
    estimator = filtered_estimator(problem.simulator, problem.task, state=charge_state, train=train)(problem.prior)
    simulated = logs(problem, simulations, problem.prior, seed)
    estimator.fit(simulated, generator=torch.Generator().manual_seed(seed))
    return estimator


def hidden_log(problem: Problem, truth: Float[Tensor, " 2"], seed: int) -> TensorDict:
    """One log (1, T) of the phone in question."""
    return logs(problem, 1, Point(truth), seed).exclude("theta")


@dataclass(frozen=True)
class Choices:
    """Choices of a policy in each sequence for each of the shares.

    Attributes:
        use: share of the sequence's seconds with the camera.
        accuracy: expected there.
    """

    use: Float[Tensor, "C E"]
    accuracy: Float[Tensor, "C E"]


def choices(score: Float[Tensor, "E T"], seen: Stretches) -> Choices:
    """The camera in the seconds of the highest score, for each share; where the threshold lies needs no label."""
    there, use, accuracy = seen.there, [], []
    for threshold in torch.quantile(score[there], 1 - SHARES).tolist():
        camera = (score > threshold) & there
        right = torch.where(camera, seen.vision_rate, seen.motion_right.float())
        use.append(camera.sum(1) / seen.length)
        accuracy.append((right * there).sum(1) / seen.length)
    return Choices(torch.stack(use), torch.stack(accuracy))


def share_paid(charge: Tensor, seconds: float, theta: Float[Tensor, " 2"]) -> Tensor:
    """The share of the time left in which the battery pays for the camera."""
    motion, camera = theta.tolist()
    return ((charge * HOUR / seconds - motion) / camera).clamp(0, 1)


@dataclass(frozen=True)
class Day:
    """Results of days with a battery.

    Attributes:
        accuracy: share of the seconds that are recognised; none after the battery is empty.
        use: share of the seconds with the camera.
        lasted: share of the time before the battery was empty.
    """

    accuracy: Float[Tensor, " N"]
    use: Float[Tensor, " N"]
    lasted: Float[Tensor, " N"]


def day(
    told: Choices,
    truth: Float[Tensor, " 2"],
    believed: Float[Tensor, " 2"],
    *,
    share: float,
    sequences: int = 40,
    seconds: float = 15.0,
    phones: int = 256,
    seed: int = 0,
) -> Day:
    """Days of ``sequences`` sequences each, on a battery that pays for the camera in a share of them.

    Args:
        told: what the policy does in the sequences that come.
        truth, believed: the currents [mA].
        share: of camera that the battery would pay for to who knows the currents.
        sequences: of a day, drawn from those that come.
        seconds: of each [s].
        phones: days that are lived at once.
        seed: of the order of the sequences.
    """
    generator = torch.Generator().manual_seed(seed)
    order = torch.randint(told.use.shape[1], (phones, sequences), generator=generator)
    motion, camera = truth.tolist()
    charge = (motion + share * camera) / HOUR * seconds * sequences
    phone = Phone(phones, dt=seconds)
    phone.reset(truth.expand(phones, 2), TensorDict({"qpos": torch.full((phones, 1), charge)}, (phones,)))
    right, used, lasted = torch.zeros(3, phones)
    for k, row in enumerate(order.unbind(1)):
        left = phone.state["qpos"].squeeze(-1)
        paid = share_paid(left, seconds * (sequences - k), believed)
        at = (paid * (len(SHARES) - 1) + 1e-6).long()
        use, accuracy = told.use[at, row], told.accuracy[at, row]
        needed = seconds / HOUR * (motion + use * camera)
        alive = (left / needed).clamp(0, 1).float()
        right, used, lasted = right + alive * accuracy, used + alive * use, lasted + alive
        phone.step(TensorDict({"command": use[:, None]}, (phones,)))
    return Day(right / sequences, used / sequences, lasted / sequences)
