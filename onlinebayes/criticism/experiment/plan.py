"""Results of an experiment's design, as frozen values; nothing in these classes computes."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.experiment.limits import Payload
from onlinebayes.criticism.results import Verdict


@dataclass(frozen=True)
class Tried:
    """One admissible input.

    Args:
        name: what it is, in words.
        scale: share of the largest admissible command that the motion's limits left.
        payload: what was fixed to the model, or None.
        sigma: expected separation of each pair, in the plan's order, to first order or refitted.
        gain: by how much the truth predicts better, over the present data and the new recordings, of each pair [nats].
        refitted: whether the models were fitted anew for it.
    """

    name: str
    scale: float
    payload: Payload | None
    sigma: tuple[float, ...]
    gain: tuple[float, ...] = ()
    refitted: bool = False


@dataclass(frozen=True)
class Remedy:
    """Something that is not there yet, and the separation that it would give."""

    what: str
    sigma: float


@dataclass(frozen=True)
class Rivalry:
    """Two rivals and what the chosen input does about them.

    Args:
        names: of the two.
        sigma: expected separation under the chosen input, the smaller of both ways round.
        best: the largest that any input tried would give.
        structural: whether that is below 4, so that no admissible recording would part them.
        remedies: what would, best first; empty where nothing that was tried does, or nothing is needed.
        gain: by how much the true one predicts better then, over the present data and the new recordings [nats].
        decides: whether the chosen input parts them by 4 sigma, and the rule asks for no larger gain.
        too_small: whether they are parted, but no admissible recording gains so much.
        accepted_from: size from which on the effect would be accepted under the chosen input [``unit``]; None where no
            effect is added.
        unit: of that size.
    """

    names: tuple[str, str]
    sigma: float
    best: float
    structural: bool
    remedies: tuple[Remedy, ...] = ()
    gain: float = 0.0
    decides: bool = True
    too_small: bool = False
    accepted_from: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class Plan:
    """The plan of the next recording.

    Args:
        verdict: of the criticism that it follows.
        chosen: the input to play.
        tried: all admissible ones, best first.
        refused: number of inputs that no scaling brought within the limits.
        recordings: how often it is to be played at least, one recording held out.
        rivalries: every pair of rivals.
        time: rows of the command table [s].
        command: what is played [command units].
        start: posture in which it begins, at rest [m, rad].
        commands, joints, signals: names.
        tracks: rival -> predicted signals at the same rows [SI].
        units: signal -> unit.
    """

    verdict: Verdict
    chosen: Tried
    tried: tuple[Tried, ...]
    refused: int
    recordings: int
    rivalries: tuple[Rivalry, ...]
    time: Float[Tensor, " K"]
    command: Float[Tensor, "K U"]
    start: Float[Tensor, " J"]
    commands: tuple[str, ...]
    joints: tuple[str, ...]
    signals: tuple[str, ...]
    tracks: dict[str, Float[Tensor, "K S"]]
    units: dict[str, str]

    @property
    def decides(self) -> bool:
        """True if a recording decides some pair of rivals."""
        return any(not rivalry.structural and not rivalry.too_small for rivalry in self.rivalries)
