"""The card of a policy: what it sees and does, in names and units, and where it comes from.

It stands in the header of ``policy.safetensors``, and as text for a reader in ``policy.md``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

from onlinebayes.policies.network import PolicyNetwork
from onlinebayes.runs import commit, versions

Channels = Mapping[str, Mapping[str, str]]
"""Observed key, or ``"action"`` -> name -> unit of each column; of each choice, where the action is discrete."""


@dataclass(frozen=True)
class Channel:
    """A column of the observation or of the action, or a choice of a discrete action.

    Args:
        name: of the column.
        unit: SI; empty for a pure number, or where nobody said.
        key: of the array that it stands in.
        low, high: bounds [unit]; None without any.
    """

    name: str
    unit: str
    key: str
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Origin:
    """The origin of a policy: task, worlds, learning.

    Args:
        task: that it was trained for.
        channels: names and units, as the task says them.
        period: from one action to the next [s]; None where nobody said.
        objective: kind of learning and its policy, as PPO.
        trained_in: the worlds, in words.
        frames: simulated, that it learnt from.
        mean_return: on the task, of the deterministic action; None where nobody judged it.
        recipe: the experiment.
    """

    task: str
    channels: Channels
    period: float | None = None
    objective: str = ""
    trained_in: str = ""
    frames: int = 0
    mean_return: float | None = None
    recipe: str = ""


@dataclass(frozen=True)
class PolicyCard:
    """The card of a policy.

    Args:
        origin: where it comes from.
        observation: the columns that it sees, in order.
        action: the columns that it gives, or the choices of a discrete action, in order.
        kind: of the action: ``"bounded"``, ``"one-hot"``, ``"index"`` or ``"plain"``.
        recurrent: whether it has a memory, which ``reset`` empties.
        version: of the library that wrote it.
        commit: of its repository; None outside of one.
    """

    origin: Origin
    observation: tuple[Channel, ...]
    action: tuple[Channel, ...]
    kind: str
    recurrent: bool
    version: str
    commit: str | None

    def seen(self) -> str:
        """``cos angle, sin angle, rate [rad/s]``."""
        return ", ".join(_told(channel) for channel in self.observation)

    def to_plain(self) -> dict[str, Any]:
        """As values that JSON can hold."""
        return asdict(self)

    @staticmethod
    def from_plain(values: Mapping[str, Any]) -> PolicyCard:
        """The inverse of :meth:`to_plain`.

        Raises:
            KeyError, TypeError: they are of no card.
        """
        seen, done = (tuple(Channel(**channel) for channel in values[name]) for name in ("observation", "action"))
        return PolicyCard(**{**values, "origin": Origin(**values["origin"]), "observation": seen, "action": done})

    def to_markdown(self) -> str:
        """The card as a reader sees it."""
        origin, kind = self.origin, KINDS[self.kind]
        score = "not judged" if origin.mean_return is None else f"{origin.mean_return:.4g}"
        facts = {
            "task": origin.task,
            "learnt by": origin.objective,
            "trained in": origin.trained_in,
            "simulated frames": f"{origin.frames}",
            "mean return": score,
            "period of an action": "not said" if origin.period is None else f"{origin.period:g} s",
            "memory": "yes: call reset() where an episode begins" if self.recurrent else "no",
            "recipe": origin.recipe,
            "onlinebayes": f"{self.version}, commit {self.commit or 'unknown'}",
        }
        lines = ["# Policy", "", "| | |", "|---|---|", *(f"| {name} | {_cell(each)} |" for name, each in facts.items())]
        lines += ["", "## Observation, in this order", "", "| column | unit | array |", "|---|---|---|"]
        lines += [f"| {_cell(each.name)} | {each.unit} | {each.key} |" for each in self.observation]
        lines += ["", f"## Action: {kind}", "", "| column | unit | low | high |", "|---|---|---|---|"]
        lines += [
            f"| {_cell(each.name)} | {each.unit} | {_bound(each.low)} | {_bound(each.high)} |" for each in self.action
        ]
        use = [
            "import onlinebayes",
            "",
            'policy = onlinebayes.load_policy("this folder")',
            "action = policy.act(observation)",
        ]
        return "\n".join([*lines, "", "```python", *use, "```", ""])


KINDS = {
    "bounded": "numbers within bounds, in this order",
    "one-hot": "one of these is 1, the others are 0",
    "index": "the place of one of these, from 0",
    "plain": "numbers, in this order",
}


def card_of(network: PolicyNetwork, origin: Origin) -> PolicyCard:
    """The card of a network: the names that the task gives its columns, numbered ones where it gives none.

    Numbered are the columns of an array, too, that a transform between task and policy has made wider or narrower.
    """
    seen = [channel for key, width in network.inputs.items() for channel in _channels(key, width, origin.channels)]
    done = _channels("action", network.outputs, origin.channels)
    if network.bounds is not None:
        low, high = network.bounds.tolist()
        done = [Channel(each.name, each.unit, each.key, low[k], high[k]) for k, each in enumerate(done)]
    recurrent = network.memory is not None
    return PolicyCard(origin, _unlike(seen), tuple(done), network.action, recurrent, *_written_by())


def _channels(key: str, width: int, channels: Channels) -> list[Channel]:
    known = channels.get(key, {})
    if len(known) != width:
        known = {f"{key}.{k}": "" for k in range(width)}
    return [Channel(name, unit, key) for name, unit in known.items()]


def _unlike(channels: list[Channel]) -> tuple[Channel, ...]:
    """The channels under names that differ; arrays may name their columns alike."""
    alike = len({channel.name for channel in channels}) < len(channels)
    return tuple(replace(each, name=f"{each.key} {each.name}") if alike else each for each in channels)


@cache
def _written_by() -> tuple[str, str | None]:
    """Version and commit of this library; git is asked once, and not after every step of a run."""
    return versions().get("onlinebayes", "unknown"), commit()


def _told(channel: Channel) -> str:
    return f"{channel.name} [{channel.unit}]" if channel.unit else channel.name


def _bound(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
