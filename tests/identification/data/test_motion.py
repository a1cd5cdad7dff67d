"""A joint whose speed is measured and whose position is not."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from onlinebayes.criticism import compare, diagnose, refine
from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.prepared_log import prepare
from onlinebayes.identification.data.start_priors import START_LOOSENESS
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.report import write_report
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import DryFriction, Effect
from tests.criticism.rigs import TRUTH, measure, model

SPEED_NOISE = 2e-3  # [m/s]
FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))


def tachometer(effects: dict[Effect, tuple[float, ...]] | None = None, seed: int = 0) -> Measurement:
    """The rig's runs as a tachometer shows them: differences of the positions, with noise of its own."""
    ruler = measure(effects, noise=1e-12, seed=seed)
    time, q = ruler.data["time"], ruler.data["signal"][..., 0]
    v = torch.gradient(q, spacing=float(time[0, 1]), dim=1)[0]
    v = v + SPEED_NOISE * torch.randn(v.shape, generator=torch.Generator().manual_seed(seed), dtype=v.dtype)
    data = ruler.data.clone()
    data["signal"] = v[..., None]
    return replace(ruler, data=data, signals=(Signal("qvel.rail", "m/s", sd=SPEED_NOISE),))


def test_windows_start_at_the_speed_that_was_measured_where_it_has_brought_the_joint() -> None:
    ruler = make_windows(model(), measure(noise=1e-12), 1.0)
    windows = make_windows(model(), tachometer(), 1.0)
    assert bool(windows.free.all())
    assert torch.allclose(windows.start[:, 0], ruler.start[:, 0], atol=3e-3)
    v, sd = windows.start[:, 1], windows.start_sd[:, 1]
    assert float(((v - ruler.start[:, 1]) / sd).abs().max()) < 0.5 * START_LOOSENESS
    assert float(sd.max()) < 2 * SPEED_NOISE


def test_the_truth_is_recovered_from_speeds_alone() -> None:
    result = compare(model(), tachometer())
    assert max(result.remainder.rms_over_floor.values()) < 1.1
    for name, truth in zip(model().parameters, TRUTH, strict=True):
        estimate = result.parameters[name]
        assert abs(estimate.mean - truth) < 4 * estimate.sd
        assert estimate.sd < 0.1 * truth


@pytest.mark.long
def test_a_hidden_friction_is_named_from_speeds_alone() -> None:
    result = refine(model(), tachometer({FRICTION: (1.5,)}), candidates=["dry_friction"])
    assert result.verdict == "missing_effect"
    assert result.accepted == ("dry_friction@rail",)
    assert result.heldout_error.after["qvel.rail"] < 0.3 * result.heldout_error.before["qvel.rail"]


@pytest.mark.long
def test_the_report_speaks_of_speeds(tmp_path: Path) -> None:
    write_report(compare(model(), tachometer({FRICTION: (1.5,)})), tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "qvel.rail" in page
    assert "m/s/s" not in page


@pytest.mark.long
def test_a_reversed_tachometer_is_a_fault_of_the_data() -> None:
    right = tachometer()
    data = right.data.clone()
    data["signal"] = -data["signal"]
    result = refine(model(), replace(right, data=data), candidates=["dry_friction"])
    assert result.verdict == "data_problem"
    assert result.wiring is not None
    assert '[signals."qvel.rail"]\nsign = -1' in result.wiring.lines


def test_what_depends_on_the_position_is_not_tried() -> None:
    simulator = model()
    windows = make_windows(simulator, tachometer(), 1.0)
    tried = {effect.name for effect in propose(simulator, windows)}
    assert "dry_friction" in tried
    assert not tried & {"joint_stiffness", "cubic_stiffness", "cogging"}
    with pytest.raises(BadInput, match="position of 'rail'"):
        propose(simulator, windows, ["joint_stiffness@rail"])


def test_a_position_that_is_needed_must_be_measured() -> None:
    sprung = model(ParameterSpace({"joint.rail.stiffness": Parameter(1.0, 10.0, "N/m")}))
    with pytest.raises(BadInput, match="the motion depends on it"):
        make_windows(sprung, tachometer(), 1.0)


def test_a_joint_that_nothing_shows_is_an_error() -> None:
    seen = tachometer()
    data = seen.data.clone()
    data["signal"], data["measured"] = data["signal"][..., :0], data["measured"][..., :0]
    with pytest.raises(BadInput, match="no measured position or velocity"):
        make_windows(model(), replace(seen, data=data, signals=()), 1.0)


@pytest.mark.parametrize("run", ["run0", "run3"])
def test_a_joint_that_one_run_does_not_show_is_an_error(run: str) -> None:
    """A fit run or the held-out one: it is named, and nothing is held at 0."""
    seen = measure(runs=4)
    assert seen.runs[-1] == "run3"
    data = seen.data.clone()
    data["measured"][seen.runs.index(run)] = False
    data["signal"][seen.runs.index(run)] = 0.0
    with pytest.raises(BadInput, match=rf"run '{run}': joint 'rail' has no measured position: no cell of qpos\.rail"):
        compare(model(), replace(seen, data=data), holdout=["run3"])


def test_a_position_that_no_run_holds_is_no_position() -> None:
    """An empty column beside a tachometer's: the velocity alone shows the joint, as without the column."""
    seen = tachometer()
    data = seen.data.clone()
    for key in ("signal", "measured"):
        data[key] = torch.cat([torch.zeros_like(data[key]), data[key]], -1)
    both = replace(seen, data=data, signals=(Signal("qpos.rail", "m"), *seen.signals))
    assert [signal.name for signal in both.seen().signals] == ["qvel.rail"]
    assert prepare(model(), both, None, None, None).fit_runs.signals == seen.signals
    data["measured"][0, :, 0] = True
    with pytest.raises(BadInput, match=r"run 'run1': .*; qvel\.rail does alone where nothing depends on the position"):
        prepare(model(), replace(both, data=data), None, None, None)


def test_a_runs_past_is_known_from_its_speeds() -> None:
    """What heat before a window follows from: the velocity as measured, the position as its integral."""
    shown = measure(noise=1e-12).data["signal"][0, :, 0]
    motion = make_windows(model(), tachometer(), 1.0).run_histories[0].motion
    assert motion is not None
    middle = (shown[1:] + shown[:-1]) / 2 - shown[0]
    rows = min(len(middle), len(motion["q"]))
    assert torch.allclose(motion["q"][:rows, 0], middle[:rows], atol=0.01 * float(shown.abs().max()))


@pytest.mark.long
def test_an_effect_that_remembers_is_tried_from_speeds_alone() -> None:
    hidden = tachometer({FRICTION: (1.5,)})
    result = diagnose(model(), hidden, candidates=["thermal_derating", "dry_friction"])
    assert {c.effect for c in result.candidates} == {"thermal_derating@motor", "dry_friction@rail"}
    assert result.accepted == ("dry_friction@rail",)
