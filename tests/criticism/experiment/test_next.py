"""The next experiment: it settles what was tied, calls structural what nothing settles, and says what would."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import Criticism, Selection, diagnose, refine
from onlinebayes.criticism.experiment import Allowed, Payload, next_experiment
from onlinebayes.criticism.experiment.adapted import adapted
from onlinebayes.criticism.experiment.deciding import strength
from onlinebayes.criticism.experiment.inputs import Inputs, Posture, admissible_inputs
from onlinebayes.criticism.experiment.limits import find_limits
from onlinebayes.criticism.experiment.play import FixedModel
from onlinebayes.criticism.experiment.rivals import AS_IT_IS, AdaptableModel, Pair, Size, find_rivals
from onlinebayes.criticism.experiment.separation import joined, predicted_windows, refitted, separations
from onlinebayes.criticism.results import Wiring
from onlinebayes.identification.data.windows import MEMORY, make_windows
from onlinebayes.identification.fitting.fit import residual_correlation_time
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fitting.rows import band_counts, band_squares
from onlinebayes.identification.judging.scoring import score_parts
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, Interrupt
from onlinebayes.simulators import Actuator, Joint, TorchSimulator
from onlinebayes.simulators.effects import ActuatorGain, ConstantLoad, Effect, QuadraticDrag, ViscousFriction
from tests.criticism import sprung
from tests.criticism.alike import Armature, BackEmf
from tests.report.synthetic import criticism

WIDE = Allowed({"motor": 40.0}, {"motor": 200.0}, {"rail": (-0.5, 0.5)}, {"rail": 2.0})


def fit_runs(measurement: Measurement) -> Measurement:
    return measurement.select([run for run in measurement.runs if run not in sprung.HELD_OUT])


@pytest.mark.long
@pytest.mark.parametrize("truth", [sprung.LOAD, sprung.SPRING])
def test_recording_what_is_proposed_settles_a_tie(truth: Effect) -> None:
    """Load and spring are tied on small motions; after the proposed recordings the right one is named alone."""
    model, candidates = sprung.model(), [sprung.LOAD, sprung.SPRING]
    real, theta = model.with_effect(truth), (*sprung.TRUTH, *sprung.SIZES[truth])
    runs = sprung.small_runs(real, theta)
    measured = sprung.measurement(runs)
    before = refine(model, measured, holdout=sprung.HELD_OUT, candidates=candidates)
    assert before.verdict == "tie"
    plan = next_experiment(before, fit_runs(measured), allowed=WIDE)
    assert plan.decides
    assert plan.rivalries[0].sigma > 20
    for k in range(1, plan.recordings):
        runs[f"next{k}"] = sprung.record(real, theta, plan.time, plan.command, float(plan.start[0]), 70 + k)
    after = refine(model, sprung.measurement(runs), holdout=sprung.HELD_OUT, candidates=candidates)
    assert (after.verdict, after.accepted) == ("missing_effect", (truth.key,))


@pytest.fixture(scope="module")
def load_pair() -> tuple[Pair, Measurement, tuple]:
    """A load of 0.3 N that may be missing, a base model that may adapt, and some inputs."""
    model = sprung.model()
    measured = sprung.measurement(sprung.small_runs(model, sprung.TRUTH, 0.4))
    windows = make_windows(model, measured, 1.0, MEMORY)
    fitted = fit(model, windows, torch.tensor(sprung.TRUTH, dtype=torch.float64))
    tau = residual_correlation_time(windows, fitted.lin)
    base = AdaptableModel(FixedModel(AS_IT_IS, model, fitted.theta), fitted, windows, tau)
    limits = find_limits(model, measured, windows, replace(WIDE, seconds=4.0), 0.0)
    start = Posture("", windows.start[0, :1], 60 * windows.start[0, :1])
    inputs = (
        admissible_inputs(windows, limits, ("motor",), [start])
        .select(torch.tensor([0, 5, 9]))
        .scaled(torch.full((3,), 0.05, dtype=torch.float64))
    )
    truth = FixedModel("friction", model.with_effect(ViscousFriction("rail", Parameter(0, 9.0))), base.hypothesis.theta)
    return Pair(truth, base), measured, (windows, inputs)


def test_what_parameters_can_do_does_not_separate(load_pair: tuple) -> None:
    """More friction while damping is free parts nothing beyond what the present data say about the damping."""
    pair, measured, (windows, inputs) = load_pair
    sigma = []
    for size in (0.0, 0.01, 0.02):
        theta = torch.cat([pair.other.hypothesis.theta, torch.tensor([size], dtype=torch.float64)])
        true = Pair(replace(pair.truth, theta=theta), pair.other)
        sigma.append(separations(true, inputs, measured.signals).sigma)
    rows = pair.other.fitted.rows
    C = rows.in_noise(rows.columns.movedim(-1, 0)) / pair.other.noise.sqrt()
    share = windows.bin_step / max(pair.other.tau, windows.bin_step)
    sd = float(torch.linalg.inv(share * torch.einsum("pwns,qwns->pq", C, C))[1, 1].sqrt())
    assert float(sigma[0].max()) < 0.05  # what the smoothing of the starts errs by
    torch.testing.assert_close(sigma[2], 2 * sigma[1], rtol=0.02, atol=0.05)
    # Two measurements of one parameter, sd a and b, differ by at most size / a however good the second is.
    assert float(sigma[1].max()) <= 0.01 / sd


def test_first_order_agrees_with_refitting_where_the_model_is_nearly_linear(load_pair: tuple) -> None:
    """A small load: what it would cost to fit present and predicted data together is what the projection says."""
    pair, measured, (_windows, inputs) = load_pair
    model = sprung.model().with_effect(sprung.LOAD)
    theta = torch.cat([pair.other.hypothesis.theta, torch.tensor([0.003], dtype=torch.float64)])
    true = Pair(FixedModel("load", model, theta), pair.other)
    quick = separations(true, inputs, measured.signals).sigma
    slow = [refitted(true, inputs.select(torch.tensor([n])), measured.signals) for n in range(3)]
    torch.testing.assert_close(quick, quick.new_tensor(slow), rtol=0.1, atol=0.1)
    assert float(quick.min()) > 3


def test_a_sensor_is_as_slow_in_the_next_recording_as_in_the_present_one(load_pair: tuple) -> None:
    """A replay's clock may be finer than the sensor's: its rows are no measurements.

    A quarter of them tells half, and somewhat more where the present data hold the other model back.
    """
    pair, measured, (windows, inputs) = load_pair
    theta = torch.cat([pair.other.hypothesis.theta, torch.tensor([0.003], dtype=torch.float64)])
    true = Pair(FixedModel("load", sprung.model().with_effect(sprung.LOAD), theta), pair.other)
    fourth = (torch.arange(windows.rows) % 4 == 3)[:, None]
    slow = replace(windows, measured=windows.measured & fourth, observed=windows.observed & fourth)
    new = predicted_windows(true, inputs, slow, measured.signals, windows.noise)
    assert float(new.measured.double().mean()) == pytest.approx(0.25, rel=0.02)
    dense, sparse = (
        separations(replace(true, other=replace(true.other, windows=one)), inputs, measured.signals).sigma
        for one in (windows, slow)
    )
    assert bool(((sparse > 0.47 * dense) & (sparse < 0.7 * dense)).all())


def test_the_gain_is_that_of_a_refit(load_pair: tuple) -> None:
    """A load of 0.003 N: its gain is what the score of a refit to both says; odds go with the square of the size."""
    pair, measured, (_windows, inputs) = load_pair
    model = sprung.model().with_effect(sprung.LOAD)
    one, gains = inputs.select(torch.tensor([1])), []
    for size in (0.003, 0.006):
        theta = torch.cat([pair.other.hypothesis.theta, torch.tensor([size], dtype=torch.float64)])
        true = Pair(FixedModel("load", model, theta), pair.other, Size(size, 0.0, "N"))
        gains.append(float(separations(true, one, measured.signals).gain))
        assert gains[-1] == pytest.approx(score_of_a_refit(true, one, measured), rel=0.1)
    small, large = (float(strength(torch.tensor(1e9), torch.tensor(gain))) for gain in gains)
    assert large == pytest.approx(2 * small, rel=2e-2)


def score_of_a_refit(pair: Pair, one: Inputs, measured: Measurement) -> float:
    """By how much worse than noise the present data and a noisy recording are predicted by the other model refitted."""
    other, model = pair.other, pair.other.hypothesis
    new = predicted_windows(pair, one, other.windows, measured.signals, other.windows.noise)
    both = joined(other.windows, new)
    found = fit(model.simulator, both, model.theta, torch.cat([other.fitted.lin.starts, new.start]))
    left, W = band_squares(both, found.rows.in_noise(found.rows.residual)), other.windows.count
    present, counts = band_squares(other.windows, other.left).sum(0), band_counts(other.windows).sum(0)
    added = band_counts(new).sum(0)
    noise = present / counts * added
    before = score_parts(present + noise, counts + added)
    return float((score_parts(left[:W].sum(0) + left[W:].sum(0) + noise, counts + added) - before).sum())


def test_more_recordings_gain_more(load_pair: tuple) -> None:
    """The present data, which show nothing, count for less."""
    pair, measured, (_windows, inputs) = load_pair
    theta = torch.cat([pair.other.hypothesis.theta, torch.tensor([0.003], dtype=torch.float64)])
    true = Pair(FixedModel("load", sprung.model().with_effect(sprung.LOAD), theta), pair.other, Size(0.003, 0.0, "N"))
    once, often = (separations(true, inputs, measured.signals, plays=n) for n in (1, 4))
    assert bool((often.gain > once.gain).all())
    torch.testing.assert_close(often.sigma, once.sigma)


def test_an_effect_that_a_parameter_mimics_contradicts_nothing(load_pair: tuple) -> None:
    """Were there friction of 0.5 N s/m, the damping that was fitted without it would be too large by that."""
    pair, measured, (windows, inputs) = load_pair
    base = pair.other.hypothesis.theta
    begin = torch.cat([base, torch.tensor([0.5], dtype=torch.float64)])
    theta = adapted(pair.truth.simulator, windows, begin, torch.tensor([True, True, False]), pair.other.fitted)
    assert float(theta[1]) == pytest.approx(float(base[1]) - 0.5, abs=1e-3)
    assert float(theta[2]) == 0.5
    unmoved, moved = (
        separations(replace(pair, truth=replace(pair.truth, theta=t)), inputs, measured.signals).sigma
        for t in (begin, theta)
    )
    assert float(moved.max()) < 0.1 < 3 < float(unmoved.max())


FREE_SLIDE = sprung.MODEL.replace(' damping="8" stiffness="60"', "")
NOTHING = ParameterSpace({"option.wind[0]": Parameter(-1.0, 1.0)})


def alike(truth: Effect, size: float, other: Effect, text: str) -> tuple[Criticism, Measurement]:
    """What ``refine`` says of two effects on a slide of which nothing else is unknown."""
    model = sprung.model(text, NOTHING)
    measured = sprung.measurement(sprung.small_runs(model.with_effect(truth), (0.0, size), 2.0))
    return refine(model, measured, holdout=sprung.HELD_OUT, candidates=[truth, other]), measured


@pytest.fixture(scope="module")
def one_law() -> tuple[Criticism, Measurement]:
    """Back-EMF and viscous friction."""
    friction, emf = ViscousFriction("rail", Parameter(0, 9.0)), BackEmf("rail", Parameter(0, 9.0))
    return alike(friction, 2.0, emf, sprung.MODEL)


@pytest.mark.long
def test_a_pair_that_nothing_parts_is_structural(one_law: tuple) -> None:
    """Two names of one law: no input, no velocity sensor and no mass parts them."""
    result, measured = one_law
    assert result.verdict == "tie"
    plan = next_experiment(result, fit_runs(measured), allowed=replace(WIDE, seconds=4.0))
    (rivalry,) = plan.rivalries
    assert rivalry.structural
    assert rivalry.best < 0.5
    assert not rivalry.remedies
    assert not plan.decides


@pytest.mark.long
def test_a_payload_parts_what_no_motion_does() -> None:
    """A weaker motor and a rotor's inertia on a free mass: a known mass parts them, offered or allowed."""
    result, measured = alike(
        Armature("rail", Parameter(0, 5.0, "kg")), 0.5, ActuatorGain("motor", Parameter(-0.6, 1.0)), FREE_SLIDE
    )
    assert result.verdict == "tie"
    runs, limits = fit_runs(measured), replace(WIDE, seconds=2.4)
    (bare,) = next_experiment(result, runs, allowed=limits).rivalries
    assert bare.structural
    assert bare.remedies[0].what == "a payload of 1 kg at body 'cart'"
    allowed = replace(limits, payload=Payload("cart", 1.0))
    plan = next_experiment(result, runs, allowed=allowed)
    assert plan.decides
    assert plan.chosen.payload == allowed.payload
    assert plan.rivalries[0].sigma > 10


def test_limits_that_admit_nothing_are_bad_input(one_law: tuple) -> None:
    """A travel in which the slide does not even hang is named, with the key that widens it."""
    result, measured = one_law
    allowed = Allowed(travel={"rail": (0.4, 0.5)}, seconds=4.0)
    with pytest.raises(BadInput, match=r"none of \d+ inputs keeps rail within the limits; widen travel"):
        next_experiment(result, fit_runs(measured), allowed=allowed)


def test_it_ends_after_the_stage_in_hand(one_law: tuple) -> None:
    """Interrupted while the rivals are fitted: no input is played, and nothing is proposed."""
    result, measured = one_law
    interrupt, said = Interrupt(), []
    interrupt.requested = True
    assert next_experiment(result, fit_runs(measured), progress=said.append, interrupt=interrupt) is None
    assert said == ["fitting the rivals"]


class Slider(TorchSimulator):
    """A mass on a rail in torch."""

    physical = ParameterSpace({"mass": Parameter(0.1, 10.0, "kg")})
    defaults: ClassVar = {"mass": 2.0}
    joints = (Joint("rail", "slide"),)
    actuators = (Actuator("motor", "rail"),)
    timestep = 0.04

    def acceleration(self, parameters, q, v, tau):
        return (tau - 4.0 * v - 20.0 * q) / parameters["mass"]


@pytest.mark.long
def test_an_adequate_torch_model_gets_the_input_that_shows_most() -> None:
    """Nothing is missing: the input is chosen by the effects at the sizes that the data cannot exclude."""
    model = Slider(["mass"])
    time = torch.arange(51, dtype=torch.float64) * 0.04
    runs = {}
    for r in range(9):
        u = (torch.sin((3 + r) * time) + torch.sin(6.7 * time + r))[:, None]
        state = model.with_worlds(1).state
        path = model.rollout(model.nominal[None], state, _commands(u), time[1:])
        q = torch.cat([torch.zeros(1), path["qpos"][0, :, 0]])
        q = q + 1e-3 * torch.randn(q.shape, generator=torch.Generator().manual_seed(r), dtype=q.dtype)
        runs[f"run{r}"] = {"time": time.numpy(), "ctrl.motor": u[:, 0].numpy(), "qpos.rail": q.numpy()}
    measured = Measurement.from_runs(runs, signals=[Signal("qpos.rail", "m", sd=1e-3)], commands=["motor"])
    candidates = [QuadraticDrag("rail", Parameter(0, 3.0)), ConstantLoad("rail", Parameter(-3.0, 3.0))]
    selection = Selection(horizon_s=0.8)
    result = diagnose(model, measured, holdout=sprung.HELD_OUT, selection=selection, candidates=candidates)
    assert result.verdict == "adequate"
    plan = next_experiment(result, fit_runs(measured), allowed=Allowed(seconds=2.0))
    assert {first.split(" = ")[0] for first, _ in (r.names for r in plan.rivalries)} == {
        "quadratic_drag@rail",
        "constant_load@rail",
    }
    assert all(r.names[1] == "the model as it is" for r in plan.rivalries)
    assert float(plan.command.abs().max()) <= float(measured.data["command"].abs().max()) + 1e-9
    assert plan.time[-1] == pytest.approx(2.0)


def test_faulty_data_are_put_right_first() -> None:
    """An effect that a reversed sign asks for is no rival of anything."""
    result = replace(criticism(), wiring=Wiring("qpos.carriage: the reversed sign", "[a]\nsign = -1", 9.0, 1.0))
    with pytest.raises(BadInput, match=r"reversed sign; put it right first: \[a\] sign = -1"):
        find_rivals(result)


def _commands(u: torch.Tensor) -> TensorDict:
    return TensorDict({"command": u[None, :-1]}, batch_size=(1, len(u) - 1))
