"""Parameters that change in time: recovered from a log with one clock, from runs with clocks of their own, and after
a jump."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from envs.pendulum import Pendulum
from onlinebayes.cli.main import main
from onlinebayes.criticism import Scope, refine
from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.identification.replaying.scoped import ScopedSimulator, unfold
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter
from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect, ParameterDrift, ParameterStep
from tests.criticism.rigs import NOISE, SLIDE, TRUTH, commands, model

STEP, ROWS, RUNS = 0.01, 301, 9
DAMPING = "joint.rail.damping"
FEW = ("parameter_drift", "parameter_step", "dry_friction", "quadratic_drag", "actuator_gain")


def table(
    damping: Callable[[float], float],
    rows: int = ROWS,
    pause: float = 1.0,
    pull: Callable[[float], float] = lambda q: 0.0,
) -> dict[str, dict]:
    """Runs of the slide, each from rest, on one clock; integrated by Runge and Kutta's method in numpy."""
    mass, draw = TRUTH[0], np.random.default_rng(0)
    runs = {}
    for r, u in enumerate(commands(RUNS, rows, STEP, 0)[..., 0].numpy()):
        t, y, path = r * (rows * STEP + pause), np.zeros(2), [0.0]

        def rate(t: float, y: np.ndarray, u: float) -> np.ndarray:
            return np.array([y[1], (u - damping(t) * y[1] + pull(y[0])) / mass])

        time = t + STEP * np.arange(rows)
        for t, force in zip(time[:-1], u[:-1], strict=True):
            a = rate(t, y, force)
            b = rate(t + STEP / 2, y + STEP / 2 * a, force)
            c = rate(t + STEP / 2, y + STEP / 2 * b, force)
            y = y + STEP / 6 * (a + 2 * b + 2 * c + rate(t + STEP, y + STEP * c, force))
            path.append(y[0])
        q = np.array(path) + NOISE * draw.normal(size=rows)
        runs[f"run{r}"] = {"time": time, "ctrl.motor": u, "qpos.rail": q}
    return runs


def measured(runs: dict[str, dict]) -> Measurement:
    return Measurement.from_runs(runs, signals=[Signal("qpos.rail", "m", sd=NOISE)], commands=["motor"])


@pytest.fixture(scope="module")
def windows() -> Windows:
    return make_windows(model(), measured(table(lambda t: 1.4)), 1.0, 0.0, None)


@pytest.mark.slow
def test_a_drift_through_the_whole_log_is_found() -> None:
    result = refine(model(), measured(table(lambda t: 1.0 + 0.03 * t)), candidates=FEW)
    assert result.accepted == (f"parameter_drift@{DAMPING}",)
    assert result.verdict == "missing_effect"
    assert result.remainder.status == "noise"
    rate = result.parameters[f"parameter_drift@{DAMPING}.rate"]
    assert rate.mean == pytest.approx(0.03, rel=0.02)
    assert rate.unit == "N s/m/s"
    # The runs that are held out come last: they lie further along the same line.
    assert result.heldout_error.after["qpos.rail"] < 0.1 * result.heldout_error.before["qpos.rail"]


@pytest.mark.long
def test_a_jump_is_found_with_its_time() -> None:
    # Within a run, and within a window of it.
    result = refine(model(), measured(table(lambda t: 1.0 + 1.2 * (t > 17.6), rows=601)), candidates=FEW)
    assert result.accepted == (f"parameter_step@{DAMPING}",)
    size, time = (result.parameters[f"parameter_step@{DAMPING}.{name}"] for name in ("size", "time"))
    assert size.mean == pytest.approx(1.2, rel=0.03)
    assert time.mean == pytest.approx(17.6, abs=0.5)


def thetas(simulator, windows: Windows, phi: list[float]) -> torch.Tensor:
    return unfold(simulator, windows, torch.tensor([phi], dtype=torch.float64))[1][0]


def test_windows_see_the_drift_at_their_middles(windows: Windows) -> None:
    drift = ParameterDrift(DAMPING, Parameter(-1.0, 1.0), middle=10.0)
    step = ParameterStep("body.cart.mass", Parameter(-9.0, 9.0), Parameter(0.0, 99.0, "s"))
    simulator = model().with_effect(drift).with_effect(step)
    begin = torch.tensor(windows.begin, dtype=torch.float64)[windows.run] + windows.first * STEP
    theta = thetas(simulator, windows, [2.0, 1.5, 0.1, 3.0, 4.51])
    # The bounds of the damping are 0 and 10 N s/m.
    torch.testing.assert_close(theta[:, 1], (1.5 + 0.1 * (begin + 0.5 - 10.0)).clamp(0.0, 10.0))
    assert theta[begin < 4.0, 0].tolist() == [2.0] * 3
    assert theta[1 + 2, 0] == pytest.approx(2.0 + 3.0 * 0.5)  # the second run begins at 4.01 s
    assert theta[4:, 0].tolist() == [5.0] * (windows.count - 4)
    # A clock that counts from 1970 says the same.
    late = replace(windows, begin=tuple(t + 1.7e9 for t in windows.begin))
    shifted = ParameterDrift(DAMPING, Parameter(-1.0, 1.0), middle=1.7e9 + 10.0)
    other = thetas(model().with_effect(shifted), late, [2.0, 1.5, 0.1])
    torch.testing.assert_close(other[:, 1], theta[:, 1], rtol=0, atol=1e-6)


def test_a_drift_is_followed_within_a_window() -> None:
    """Damping that rises from 1 to 4 N s/m in a run's first window, against Runge and Kutta's method in numpy."""
    one = measured({"run0": table(lambda t: 1.0 + 3.0 * t)["run0"]})
    first = make_windows(model(), one, 1.0, 0.0, None).select(torch.tensor([0]))
    at_rest = torch.zeros(1, 1, 2, dtype=torch.float64)
    simulator = model().with_effect(ParameterDrift(DAMPING, Parameter(-3.0, 3.0), middle=0.0))
    followed, valid = replay(simulator, first, torch.tensor([[TRUTH[0], 1.0, 3.0]], dtype=torch.float64), at_rest)
    held, _ = replay(model(), first, torch.tensor([[TRUTH[0], 2.5]], dtype=torch.float64), at_rest)
    assert bool(valid.all())
    errors = [float((first.value - signals[0]).abs().max()) for signals in (followed, held)]
    assert errors[0] < 5 * NOISE
    assert errors[1] > 25 * NOISE


@pytest.mark.parametrize("cls", [ParameterDrift, ParameterStep], ids=lambda cls: cls.name)
def test_at_neutral_nothing_changes_and_a_batch_is_its_members(cls: type[Effect], windows: Windows) -> None:
    (effect,) = propose(model(), windows, [f"{cls.name}@{DAMPING}"])
    simulator = model().with_effect(effect)
    theta = torch.stack([torch.cat([torch.tensor(TRUTH).double(), simulator.nominal[2:]])] * 3)
    theta[1, 2], theta[2, 2] = effect.parameters[effect.parameters.names[0]].high / 3, 0.1
    signals, valid = replay(simulator, windows, theta, windows.start.expand(3, -1, -1))
    plain, _ = replay(model(), windows, theta[:1, :2], windows.start[None])
    assert bool(valid.all())
    assert torch.equal(signals[0], plain[0])
    assert not torch.equal(signals[1], plain[0])
    for k in range(3):
        assert torch.equal(replay(simulator, windows, theta[k : k + 1], windows.start[None])[0][0], signals[k])


def test_a_value_of_each_run_drifts_with_the_others(windows: Windows) -> None:
    drift = ParameterDrift(DAMPING, Parameter(-1.0, 1.0), middle=0.0)
    scoped = ScopedSimulator(model(), Scope(per_run=(DAMPING,)), windows.runs).with_effect(drift)
    assert scoped.parameters.names[-1] == f"parameter_drift@{DAMPING}.rate"
    phi = [2.0, *(1.0 + 0.1 * r for r in range(RUNS)), 0.01]
    middle = torch.tensor(windows.begin, dtype=torch.float64)[windows.run] + windows.first * STEP + 0.5
    torch.testing.assert_close(thetas(scoped, windows, phi)[:, 1], 1.0 + 0.1 * windows.run + 0.01 * middle)


def test_only_what_is_named_and_free_is_tried(windows: Windows) -> None:
    assert not any(effect.target_kind == "parameter" for effect in propose(model(), windows))
    keys = [effect.key for effect in propose(model(), windows, ["parameter_drift", f"parameter_step@{DAMPING}"])]
    assert keys == ["parameter_drift@body.cart.mass", f"parameter_drift@{DAMPING}", f"parameter_step@{DAMPING}"]
    with pytest.raises(BadInput, match=r"nearest: joint\.rail\.damping"):
        propose(model(), windows, ["parameter_drift@joint.rail.dampin"])
    with pytest.raises(BadInput, match=r"'joint\.rail\.armature' of parameter_drift@joint\.rail\.armature is unknown"):
        model().with_effect(ParameterDrift("joint.rail.armature", Parameter(-1.0, 1.0)))
    drift = ParameterDrift("length", Parameter(-1.0, 1.0))
    pendulum = Pendulum(["length"]).with_effect(drift)
    assert pendulum.parameters.names == ("length", "parameter_drift@length.rate")
    with pytest.raises(BadInput, match="nearest: length"):
        Pendulum(["length"]).with_effect(replace(drift, target="lenth"))


@pytest.mark.slow
def test_a_refined_problem_with_a_drift_loads_again(tmp_path: Path) -> None:
    rows = ["run,time,ctrl.motor,qpos.rail"]
    for run, columns in table(lambda t: 1.0 + 0.03 * t).items():
        rows += [f"{run},{t:.2f},{u:.9f},{q:.9f}" for t, u, q in zip(*columns.values(), strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "slide.xml").write_text(SLIDE)
    (tmp_path / "slide.toml").write_text(f"""
schema = 1
model = "slide.xml"
measurements = ["log.csv"]
[parameters]
"body.cart.mass" = [0.5, 8.0]
"{DAMPING}" = [0.0, 10.0]
[signals."qpos.rail"]
sd = {NOISE}
[effects]
candidates = ["parameter_drift@{DAMPING}", "dry_friction"]
""")
    out = tmp_path / "out"
    assert main(["refine", str(tmp_path / "slide.toml"), "--out", str(out)]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["accepted"] == [f"parameter_drift@{DAMPING}"]
    assert report["parameters"][f"parameter_drift@{DAMPING}.rate"]["mean"] == pytest.approx(0.03, rel=0.02)
    assert f"without parameter_drift@{DAMPING}" in (out / "refined.xml").read_text()
    (again,) = load_problem(out / "refined.toml").simulator.effects
    assert again.key == f"parameter_drift@{DAMPING}"
    assert again.middle == pytest.approx(12.0, abs=0.5)
