"""The state of a run, and the record of each outer step."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.inference import Belief, FitReport, History
from onlinebayes.inference.saving import from_state, to_state
from onlinebayes.parameters import ParameterSpace
from onlinebayes.trainers.following import from_plain, to_plain
from onlinebayes.trainers.hypotheses import OpenHypotheses, open_from_plain
from onlinebayes.trainers.trajectories import Policy


@dataclass(frozen=True)
class Record:
    """One outer step, for tables, plots and recordings.

    Attributes:
        step: counted from 1.
        frames: simulated frames that the policy has learnt from so far.
        simulated: simulated frames that the belief has learnt from so far.
        seconds: spent in each part of this step [s]: ``"policy"``, ``"real"``, ``"simulate"``, ``"fit"``, ``"gate"``.
        losses: means of the policy's losses in the last batch; empty where it did not learn.
        fit: how the training of the estimator went; None where there was none.
        coverage: share of held-out truths in the belief's 95 % region; None where there was no fit.
        calibration: the same share for each of ``calibration.LEVELS``; empty where there was no fit.
        notes: what went wrong or was decided, one line each.
        belief: mean and standard deviation of each parameter [SI].
        quantiles: 5 %, 50 % and 95 % of each parameter [SI]; empty in a run of before they were kept.
        figures: what a judge said of the step, by name.
        grown: keys of the effects that criticism had added to the model by then.
    """

    step: int
    frames: int
    simulated: int
    seconds: dict[str, float]
    losses: dict[str, float]
    fit: FitReport | None = None
    coverage: float | None = None
    notes: tuple[str, ...] = ()
    calibration: tuple[float, ...] = ()
    belief: dict[str, tuple[float, float]] = field(default_factory=dict)
    figures: dict[str, float] = field(default_factory=dict)
    grown: tuple[str, ...] = ()
    quantiles: dict[str, tuple[float, float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Inferred:
    """Result of the inference of an outer step; see :class:`Record`."""

    fit: FitReport
    coverage: float
    calibration: tuple[float, ...]


@dataclass
class OnlineState:
    """State of a run.

    Attributes:
        belief: what is known of theta from all real trajectories; the prior at first. This is what is reported.
        proposal: where the next simulations are drawn; the prior at first.
        real: the real trajectories (n, T) with their ``"mask"``, None before the first.
        policies: weights of the policies that made them, or of what repeats their commands.
        made_by: for each real trajectory the index of its policy.
        records: one for each complete outer step.
        batches: policy batches done in the outer step under way.
        measured: whether the real system has been asked in it.
        notes: on what happened in it.
        frames: simulated frames that the policy has learnt from.
        simulated: simulated frames that the belief has learnt from.
        losses: of the last policy batch.
        effects: that criticism has added to the model, as plain values.
        criticised: complete outer steps when criticism was last asked.
        hypotheses: the models that criticism left open, with what later trajectories said of them; None for no choice.
        weighed: real trajectories that their weights know.
        aside: seconds spent on criticism since the last record [s], by the name of the work.
        history: what was made of the real trajectories, where the machine may change; None before the first.
        interrupted: whether the run was stopped before its last step.
        anew: whether the policy's next batch begins new episodes, for the worlds cannot say where they stood.
    """

    belief: Belief
    proposal: Belief
    real: TensorDict | None = None
    policies: list[Mapping[str, Any]] = field(default_factory=list)
    made_by: list[int] = field(default_factory=list)
    records: list[Record] = field(default_factory=list)
    batches: int = 0
    measured: bool = False
    notes: list[str] = field(default_factory=list)
    frames: int = 0
    simulated: int = 0
    losses: dict[str, float] = field(default_factory=dict)
    effects: list[dict[str, Any]] = field(default_factory=list)
    criticised: int = 0
    hypotheses: OpenHypotheses | None = None
    weighed: int = 0
    aside: dict[str, float] = field(default_factory=dict)
    history: History | None = None
    interrupted: bool = False
    anew: bool = False

    @classmethod
    def begin(cls, prior: Belief) -> OnlineState:
        """Nothing is known yet but the prior."""
        return cls(belief=prior, proposal=prior)

    @property
    def step(self) -> int:
        """Number of complete outer steps."""
        return len(self.records)

    def complete(self, seconds: dict[str, float], inferred: Inferred | None) -> None:
        """Write the record of the outer step under way and begin the next."""
        belief, quantiles = described(self.belief)
        record = Record(
            step=self.step + 1,
            frames=self.frames,
            simulated=self.simulated,
            seconds={**self.aside, **seconds},
            losses=dict(self.losses) if self.batches else {},
            notes=tuple(self.notes),
            belief=belief,
            quantiles=quantiles,
            grown=tuple(f"{effect['name']}@{effect['target']}" for effect in self.effects),
        )
        if inferred is not None:
            record = replace(record, fit=inferred.fit, coverage=inferred.coverage, calibration=inferred.calibration)
        self.records.append(record)
        self.batches, self.measured, self.notes, self.aside = 0, False, [], {}

    def kept(self) -> str:
        """Say what the run has so far."""
        measured = 0 if self.real is None else len(self.real)
        belief = f"the belief from {measured} real trajectories" if measured else "the prior as belief"
        return f"{self.step} outer steps, {belief}, a policy after {self.frames} frames"

    def state_dict(self) -> dict[str, Any]:
        """All of it as plain values."""
        return {
            "belief": to_state(self.belief),
            "proposal": to_state(self.proposal),
            "real": None if self.real is None else dict(self.real.flatten_keys(".").items()),
            "policies": list(self.policies),
            "made_by": list(self.made_by),
            "records": [asdict(record) for record in self.records],
            "clock": [self.batches, self.measured, self.frames, self.simulated],
            "notes": list(self.notes),
            "losses": dict(self.losses),
            "effects": [dict(effect) for effect in self.effects],
            "criticised": self.criticised,
            "hypotheses": None if self.hypotheses is None else self.hypotheses.to_plain(),
            "weighed": self.weighed,
            "aside": dict(self.aside),
            "history": to_plain(self.history),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Stand where :meth:`state_dict` was taken."""
        space = self.belief.space
        self.belief, self.proposal = from_state(space, state["belief"]), from_state(space, state["proposal"])
        real = state["real"]
        if real is not None:
            self.real = TensorDict(dict(real), batch_size=real["mask"].shape[:2]).unflatten_keys(".")
        self.policies = list(state["policies"])
        self.made_by = list(state["made_by"])
        self.records = [_record(values) for values in state["records"]]
        self.batches, self.measured, self.frames, self.simulated = state["clock"]
        self.notes = list(state["notes"])
        self.losses = dict(state["losses"])
        self.effects = [dict(effect) for effect in state.get("effects", ())]
        self.history = from_plain(space, state.get("history"))
        self.criticised, self.aside = state.get("criticised", 0), dict(state.get("aside", {}))
        self.hypotheses, self.weighed = open_from_plain(state.get("hypotheses")), state.get("weighed", 0)


def frozen(policy: Policy, weights: Mapping[str, Any] | None = None) -> Policy:
    """A copy of a policy that learns no more, with other weights where they are given."""
    copied = copy.deepcopy(policy).requires_grad_(False)
    if weights is not None:
        copied.load_state_dict(weights)
    return copied


def described(belief: Belief) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float, float]]]:
    """Mean and standard deviation, and 5 %, 50 % and 95 %, of each parameter [SI], by draws with a fixed seed."""
    names = belief.space.names
    if not names:
        return {}, {}
    draws = belief.sample((4000,), torch.Generator().manual_seed(0))
    low, middle, high = torch.quantile(draws, draws.new_tensor([0.05, 0.5, 0.95]), dim=0).tolist()
    moments = zip(draws.mean(0).tolist(), draws.std(0).tolist(), strict=True)
    return dict(zip(names, moments, strict=True)), dict(zip(names, zip(low, middle, high, strict=True), strict=True))


def mean_of(record: Record, space: ParameterSpace) -> Float[Tensor, " P"]:
    """The belief's mean after a step, within the bounds."""
    return space.clamp(space.vector({name: record.belief[name][0] for name in space.names}))


def _record(values: Mapping[str, Any]) -> Record:
    fit, tuples = (
        values["fit"],
        {name: tuple(values[name]) for name in ("notes", "calibration", "grown") if name in values},
    )
    return Record(**{**values, **tuples, "fit": None if fit is None else FitReport(**fit)})
