"""The design of the next recording: of all admissible inputs the one under which the rivals differ most.

    chosen = argmax over inputs u of  min over pairs of rivals (a, b) of  strength(a, b; u)

Strength says how far the rule that will judge the recording is reached (:mod:`.deciding`), the smaller of both ways
round: whichever of the two is true, the other must go. The inputs are compared to first order; the best few, and each
pair's own best, with the models fitted anew. A pair that no input parts by 4 sigma is structural; one that no input
decides takes no part in the choice, unless all are so. Atkinson and Fedorov (1975): designs that
discriminate between models (T-optimality), here with what the present data say as the prior.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.experiment.check import check_table
from onlinebayes.criticism.experiment.deciding import PARTED, accepted_from, rescaled, strength
from onlinebayes.criticism.experiment.inputs import Inputs, admissible_inputs
from onlinebayes.criticism.experiment.limits import Allowed, Limits, Payload, find_limits
from onlinebayes.criticism.experiment.plan import Plan, Remedy, Rivalry, Tried
from onlinebayes.criticism.experiment.play import FixedModel, admissible, play
from onlinebayes.criticism.experiment.postures import postures
from onlinebayes.criticism.experiment.remedies import loaded, loaded_pair, remedies
from onlinebayes.criticism.experiment.rivals import Rivals, find_rivals
from onlinebayes.criticism.experiment.separation import refitted, separations
from onlinebayes.identification.data.grid import row_step
from onlinebayes.identification.data.windows import joint_names
from onlinebayes.identification.fitting.blocks import BLOCK_CORRELATION_TIMES, FEWEST_BLOCKS
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, Interrupt, Watch, one_torch_thread

FEWEST_INPUTS, MOST_INPUTS = 12, 96
WORK = 2e7  # integration steps that comparing the inputs may take: minutes for an arm of six joints
REFITTED = 3
REPEATS = 4  # new runs outweigh all older ones


@dataclass(frozen=True)
class _Trials:
    """All admissible inputs without or with a payload, and what every rivalry is under each."""

    inputs: Inputs
    payload: Payload | None
    sigma: Float[Tensor, "N R"]
    gain: Float[Tensor, "N R"]
    refitted: Bool[Tensor, " N"]

    @property
    def strength(self) -> Float[Tensor, "N R"]:
        """See :mod:`.deciding`."""
        return strength(self.sigma, self.gain)


@one_torch_thread()
def next_experiment(
    result: Criticism,
    measurement: Measurement,
    *,
    allowed: Allowed | None = None,
    progress: Callable[[str], None] | None = None,
    interrupt: Interrupt | None = None,
) -> Plan | None:
    """The recording that would decide what a criticism leaves open.

    Args:
        result: what ``diagnose`` or ``refine`` found.
        measurement: the runs that it fitted, without those held out.
        allowed: the user's own limits.
        progress: takes one line of text between stages.
        interrupt: ends the work at its next replay.

    Returns:
        The plan; None where it was interrupted.

    Raises:
        BadInput: no actuators, a free or ball joint, no rivals, no posture that a command holds, or limits that
            admit no input at all.
    """
    joint_names(result.base.simulator)  # refuses free and ball joints: postures are not drawn for them
    watch = Watch(interrupt=interrupt) if progress is None else Watch(progress, interrupt)
    with watch.giving_up():
        watch.say("fitting the rivals")
        rivals = find_rivals(result)
        return None if watch.stopped else _proposed(result, rivals, measurement, allowed or Allowed(), watch)
    return None


def _proposed(
    result: Criticism, rivals: Rivals, measurement: Measurement, allowed: Allowed, watch: Watch
) -> Plan | None:
    """The plan that parts these rivals; None where it was interrupted."""
    model = rivals.hypotheses[0].simulator
    limits = find_limits(model, measurement, rivals.windows, allowed, _least_seconds(rivals))
    starts = postures(rivals.windows, limits, rivals.hypotheses[0])
    every = admissible_inputs(rivals.windows, limits, model.commands, starts, _affordable(rivals, limits))
    plays = max(REPEATS, math.ceil(_least_seconds(rivals) / limits.seconds))
    trials = []
    for payload in (None, *([allowed.payload] if allowed.payload else [])):
        carrying = f" with {payload.mass:g} kg at '{payload.body}'" if payload else ""
        watch.say(f"playing {every.count} inputs{carrying}")
        safe = admissible([loaded(h, payload) for h in rivals.hypotheses], every, limits)
        if safe.count:
            trials.append(_compared(rivals, safe, payload, measurement, plays))
        if watch.stopped:
            return None
    if not trials:
        raise BadInput(
            f"none of {every.count} inputs keeps {', '.join(joint_names(model))} within the limits",
            "widen travel, max_speed or max_command under [next]",
        )
    watch.say("refitting under the best inputs")
    if trials[0].payload is None:
        trials[0] = _confirmed(rivals, trials[0], measurement, watch)
    if watch.stopped:
        return None
    plan = _plan(result, rivals, limits, trials, measurement)
    return replace(plan, refused=every.count - trials[0].inputs.count, recordings=plays + 1)


def _affordable(rivals: Rivals, limits: Limits) -> int:
    """Count the inputs to compare: each costs a replay for itself, every start and every parameter of every pair."""
    joints = len(limits.speed)
    worlds = sum(1 + 2 * joints + len(pair.other.hypothesis.theta) for pair in rivals.pairs)
    steps = worlds * limits.seconds / rivals.hypotheses[0].simulator.timestep
    return min(MOST_INPUTS, max(FEWEST_INPUTS, int(WORK / steps)))


def _least_seconds(rivals: Rivals) -> float:
    """Return the duration that enough independent blocks need [s], as correlated as the residual is now."""
    longest = max(pair.other.tau for pair in rivals.pairs)
    return (FEWEST_BLOCKS + 1) * max(
        rivals.windows.horizon, min(BLOCK_CORRELATION_TIMES * longest, 10 * rivals.windows.horizon)
    )


def _compared(rivals: Rivals, inputs: Inputs, payload: Payload | None, measurement: Measurement, plays: int) -> _Trials:
    pairs = [loaded_pair(pair, payload) for pair in rivals.pairs]
    each = [separations(pair, inputs, measurement.signals, plays=plays) for pair in pairs]
    sigma = torch.stack([torch.stack([each[k].sigma for k in rivals.of(n)]).amin(0) for n in rivals.names], -1)
    gain = torch.stack([torch.stack([each[k].gain for k in rivals.of(n)]).amin(0) for n in rivals.names], -1)
    return _Trials(inputs, payload, sigma, gain, torch.zeros(inputs.count, dtype=torch.bool, device=sigma.device))


def _confirmed(rivals: Rivals, trials: _Trials, measurement: Measurement, watch: Watch) -> _Trials:
    """The leading inputs with the models fitted anew, until it is interrupted."""
    order = _worth(trials.strength).argsort(descending=True)[:REFITTED].tolist()
    leading = dict.fromkeys([*order, *trials.strength.argmax(0).tolist()])
    sigma, gain, done = trials.sigma.clone(), trials.gain.clone(), trials.refitted.clone()
    for n in leading:
        if watch.stopped:
            break
        one = trials.inputs.select(torch.tensor([n], device=sigma.device))
        each = [refitted(pair, one, measurement.signals) for pair in rivals.pairs]
        sigma[n] = sigma.new_tensor([min(each[k] for k in rivals.of(names)) for names in rivals.names])
        # What is gained is what the separation is made of.
        gain[n] = rescaled(gain[n], sigma[n] / trials.sigma[n].clamp_min(1e-12))
        done[n] = True
    return replace(trials, sigma=sigma, gain=gain, refitted=done)


def _worth(strong: Float[Tensor, "N R"]) -> Float[Tensor, " N"]:
    """The smallest strength of each input over the rivalries that some input decides; over all where none does."""
    open_ = strong.amax(0) >= 1
    return strong[:, open_].amin(-1) if bool(open_.any()) else strong.amin(-1)


def _plan(
    result: Criticism,
    rivals: Rivals,
    limits: Limits,
    trials: Sequence[_Trials],
    measurement: Measurement,
) -> Plan:
    sigma, gain = (torch.cat([getattr(part, name) for part in trials]) for name in ("sigma", "gain"))
    tried = [one for part in trials for one in _tried(part)]
    worth = _worth(strength(sigma, gain))
    # Compare refitted inputs only: the linear prediction is too high for nonlinear models.
    eligible = torch.cat([part.refitted | (part.payload is not None) for part in trials])
    order = torch.where(eligible, worth, worth - 1e9).argsort(descending=True).tolist()
    best = order[0]
    part, row = (trials[0], best) if best < trials[0].inputs.count else (trials[1], best - trials[0].inputs.count)
    chosen = part.inputs.select(torch.tensor([row], device=sigma.device))
    rivalries = _rivalries(rivals, limits, trials[0], sigma, gain, best, measurement)
    time, command = _table(chosen, measurement)
    check_table(time, command, chosen.held[0], limits, rivals.hypotheses[0].simulator.commands)
    tracks = {h.name: _track(loaded(h, part.payload), chosen, rivals, time) for h in rivals.hypotheses}
    model = rivals.hypotheses[0].simulator
    return Plan(
        verdict=result.verdict,
        chosen=tried[best],
        tried=tuple(tried[k] for k in order),
        refused=0,
        recordings=REPEATS + 1,
        rivalries=rivalries,
        time=time,
        command=command,
        start=chosen.start[0],
        commands=tuple(model.commands),
        joints=joint_names(model),
        signals=tuple(signal.name for signal in measurement.signals),
        tracks=tracks,
        units={signal.name: signal.unit for signal in measurement.signals},
    )


def _tried(part: _Trials) -> list[Tried]:
    rows = zip(
        part.inputs.names,
        part.inputs.scale.tolist(),
        part.sigma.tolist(),
        part.gain.tolist(),
        part.refitted.tolist(),
        strict=True,
    )
    return [
        Tried(name, scale, part.payload, tuple(sigma), tuple(gain), done) for name, scale, sigma, gain, done in rows
    ]


def _rivalries(
    rivals: Rivals,
    limits: Limits,
    bare: _Trials,
    sigma: Float[Tensor, "N R"],
    gain: Float[Tensor, "N R"],
    best: int,
    measurement: Measurement,
) -> tuple[Rivalry, ...]:
    found, strong = [], strength(sigma, gain)
    for r, names in enumerate(rivals.names):
        most, pairs = float(sigma[:, r].max()), [rivals.pairs[k] for k in rivals.of(names)]
        structural = most < PARTED
        helps: tuple[Remedy, ...] = ()
        if structural:
            closest = bare.inputs.select(bare.sigma[:, r].argsort(descending=True)[:REFITTED])
            helps = remedies(pairs, closest, limits, measurement.signals)
        added = pairs[0].added
        found.append(
            Rivalry(
                names,
                float(sigma[best, r]),
                most,
                structural,
                helps,
                gain=float(gain[best, r]),
                decides=float(strong[best, r]) >= 1,
                too_small=not structural and float(strong[:, r].max()) < 1,
                accepted_from=accepted_from(added, float(strong[best, r])),
                unit=added.unit if added else "",
            )
        )
    return tuple(found)


def _table(inputs: Inputs, measurement: Measurement) -> tuple[Float[Tensor, " T"], Float[Tensor, "T U"]]:
    """The one input's command on the measurement's clock, straight between the rows of the replay's."""
    step, K = row_step(measurement), inputs.command.shape[1]
    command = inputs.command[0]
    rows = round((K - 1) * inputs.step / step) + 1
    time = torch.arange(rows, dtype=command.dtype, device=command.device) * step
    return time, _between(command, inputs.step, time)


def _track(hypothesis: FixedModel, inputs: Inputs, rivals: Rivals, time: Tensor) -> Float[Tensor, "T S"]:
    simulator = hypothesis.simulator
    signals = simulator.read(play(hypothesis, inputs))[0][:, list(rivals.windows.columns)]
    return _between(signals, inputs.step, time)


def _between(rows: Float[Tensor, "K C"], step: float, time: Float[Tensor, " T"]) -> Float[Tensor, "T C"]:
    """Linear interpolation of rows at spacing ``step``; the rows themselves where the clocks agree."""
    place = time / step
    nearest = place.round()
    place = torch.where((place - nearest).abs() < 1e-6, nearest, place).clamp(0, len(rows) - 1)
    low = place.floor().long().clamp_max(len(rows) - 2)
    share = (place - low)[:, None]
    return rows[low] + share * (rows[low + 1] - rows[low])
