"""One judged case: what was hidden, what refine said, and by which rules that was right.

    ratio = e(base model refitted) / e(true effects added by hand and fitted),     e: RMS over held-out signals [floors]
    share = (e(base) - e(final)) / (e(base) - e(true effects))

The ratio that was measured, not the size that was drawn, decides under which size a case is counted. Below 1.3 an
effect is faint: to find it is no merit, to overlook it no fault. One of two effects is faint beside the other by the
same measure, e(true effects without it) / e(true effects); such cases count, and stand in a row of their own besides.

What is off in the model may be named by its number, or by the effect that is the same law: either is the same answer.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from onlinebayes.criticism import Verdict
from recipes.studies.blind_rigs.names import Answer, answer, spellings

RIGHT: Mapping[str, Verdict] = {
    "effect": "missing_effect",
    "null": "adequate",
    "tie": "tie",
    "outside": "unexplained",
    "bounds": "bounds_exclude_truth",
    "wiring": "data_problem",
    "short": "insufficient_data",
    "surplus": "bounds_exclude_truth",
    "own": "bounds_exclude_truth",
}
# Words of which the named fault must hold one; a command's unit is too large or too small.
CURES: Mapping[str, tuple[str, ...]] = {
    "sign": ("sign",),
    "degrees": ("degrees for radians",),
    "offset": ("zero",),
    "swapped": ("swapped",),
    "latency": ("late",),
    "actuator_off": ("off",),
    "gravity_compensation": ("gravity",),
}
SIZES: Mapping[str, tuple[float, float]] = {
    "faint": (0.0, 1.3),
    "weak": (1.3, 2.0),
    "medium": (2.0, 4.0),
    "strong": (4.0, float("inf")),
}
FAINT = SIZES["faint"][1]


@dataclass(frozen=True)
class Judged:
    """A case and what became of it.

    Args:
        rig, kind, seed: which case.
        hidden: effects as the library spells them, or the number of the model that is off.
        partners: those that explain the log as well, by the rig's own account.
        level: the size that was drawn.
        fault: of the log or of the bounds.
        ended: empty, or why there is no answer: out of time, or the error.
        verdict, accepted: what refine said.
        first, gain, gain_se: the candidate ranked first, its score gain with its standard error [nats].
        equal: what the first accepted effect cannot be told from.
        refused: right name -> why it was not accepted.
        widened: parameters whose bounds were widened.
        wiring: the fault that was named.
        before, after, reference: held-out error of the base, the final and the true model [floors].
        beside: of two hidden effects, each one -> held-out error of the true model without it over the true model's.
        covered, intervals: 90 % intervals that hold the truth, of those given where the right model was found.
        left: rms_over_floor of the final model, the worst signal's.
        contradicted: what was added and taken out again for the held-out runs.
        named: what speaks for each name that was said, the fields of :class:`~onlinebayes.criticism.Named`.
        deviations: parameter -> (estimate - truth) / half its 90 % interval, where the right model was found.
        seconds: of processor time that refine took [s].
    """

    rig: str
    kind: str
    seed: int
    hidden: tuple[str, ...] = ()
    partners: tuple[str, ...] = ()
    level: str = ""
    fault: str = ""
    ended: str = ""
    verdict: str = ""
    accepted: tuple[str, ...] = ()
    first: str = ""
    gain: float | None = None
    gain_se: float | None = None
    equal: tuple[str, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    widened: tuple[str, ...] = ()
    wiring: str = ""
    before: float | None = None
    after: float | None = None
    reference: float | None = None
    beside: Mapping[str, float] = field(default_factory=dict)
    covered: int = 0
    intervals: int = 0
    left: float | None = None
    contradicted: tuple[str, ...] = ()
    named: tuple[Mapping[str, Any], ...] = ()
    deviations: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def name(self) -> str:
        """``rig-kind-seed``."""
        return f"{self.rig}-{self.kind}-{self.seed}"

    @property
    def answers(self) -> tuple[Answer, ...]:
        """The rule for finding each hidden effect."""
        return tuple(answer(self.rig, key) for key in self.hidden)

    @property
    def ratio(self) -> float | None:
        """Held-out error of the base model over that of the true one; over the floor where the library lacks it."""
        return None if self.before is None else self.before / (self.reference or 1.0)

    @property
    def size(self) -> str:
        """Faint, weak, medium or strong by the measured ratio; as drawn where there is none."""
        if self.ratio is None:
            return self.level
        return next(name for name, (low, high) in SIZES.items() if low <= self.ratio < high)

    @property
    def counts(self) -> bool:
        """True if the case can be right or wrong: all but faint effects."""
        return self.kind != "effect" or self.size != "faint"

    @property
    def shows(self) -> bool:
        """True if each of two hidden effects lowers the held-out error beside the other."""
        return len(self.beside) > 1 and min(self.beside.values()) >= FAINT

    @property
    def right(self) -> bool:
        """True if the verdict is right: the kind's own, and about the right thing where it names one."""
        if self.kind == "effect":
            named = self.verdict == "missing_effect" or (
                self.verdict == RIGHT["own"] and self._named(self.accepted[:1])
            )
            return named or (self.verdict == "tie" and self._equals_are_partners())
        if self.kind in ("surplus", "own"):
            named = self.verdict in (RIGHT["own"], RIGHT["effect"]) and self._named(self.accepted[:1])
            return named or (self.verdict == "tie" and self._named((*self.accepted[:1], *self.equal)))
        if self.verdict != RIGHT[self.kind]:
            return False
        if self.kind == "tie":
            return all(members & {*self.accepted[:1], *self.equal} for members in self._members())
        if self.kind == "wiring":
            return self._cured()
        return self.kind != "bounds" or self.widened == (self.fault,)

    @property
    def first_right(self) -> bool:
        """True if the first-ranked candidate is hidden, or a part of what is and the rest was found too."""
        return any(
            answer.named(self.first) or (answer.admits(self.first) and answer.found(self.accepted))
            for answer in self.answers
        )

    @property
    def first_or_tied(self) -> bool:
        """True if the first-ranked candidate is right, or is said to be indistinguishable from what is hidden."""
        return self.first_right or self._tied_with_hidden()

    @property
    def all_found(self) -> bool:
        """True if every hidden effect was accepted."""
        return all(answer.found(self.accepted) for answer in self.answers)

    @property
    def innocent(self) -> tuple[str, ...]:
        """The accepted effects that are not there."""
        if self.kind in ("outside", "wiring", "bounds", "short"):
            return ()  # a wrong verdict is counted there; what it names is neither hidden nor innocent
        members = frozenset[str]().union(*self._members()) if self.kind == "tie" else frozenset[str]()
        return tuple(
            key for key in self.accepted if key not in members and not any(a.admits(key) for a in self.answers)
        )

    @property
    def accused(self) -> tuple[str, ...]:
        """Those of them that are not said to be indistinguishable from what is hidden."""
        said = self.accepted[:1] if self._tied_with_hidden() else ()
        return tuple(key for key in self.innocent if key not in said)

    @property
    def share(self) -> float | None:
        """Part of what the true effects give that refine gave, between 0 and 1; None where they give nothing."""
        if self.before is None or self.after is None or self.reference is None or self.reference >= self.before:
            return 0.0 if self.ended and self.counts else None
        return min(max((self.before - self.after) / (self.before - self.reference), 0.0), 1.0)

    @property
    def missed(self) -> bool:
        """True if anything about it is worth a look."""
        if not self.counts:
            return bool(self.innocent)
        named = self.kind != "effect" or (self.all_found and (len(self.hidden) > 1 or self.first_right))
        wrong = self.innocent if self.kind == "effect" else self.accused
        return not (self.right and named) or bool(wrong)

    def _named(self, keys: Iterable[str]) -> bool:
        """Check whether one of these keys is right alone."""
        return any(answer.named(key) for answer in self.answers for key in keys)

    def _tied_with_hidden(self) -> bool:
        """Check whether the first accepted effect is said to be indistinguishable from one that is hidden."""
        return self.verdict == "tie" and self._named(self.equal)

    def _members(self) -> tuple[frozenset[str], frozenset[str]]:
        """Both sides of a tie, each in every spelling."""
        hidden = frozenset[str]().union(*(spellings(key) for key in self.hidden))
        return hidden, frozenset[str]().union(*(spellings(key) for key in self.partners))

    def _cured(self) -> bool:
        """Check whether the fault that was named is the one that was made: a wrong cure is no right answer."""
        kind, _, rest = self.fault.partition(" ")
        words = CURES[kind] if kind in CURES else ("large",) if rest.endswith(" 10") else ("small",)
        return any(word in self.wiring for word in words)

    def _equals_are_partners(self) -> bool:
        """Check whether a tie on an effect set is the rig's own: its members are names of what is hidden."""
        return bool(self.equal) and all(self._named([key]) for key in self.equal)
