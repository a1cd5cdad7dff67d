"""Several units of one machine: the spread of what differs between them, and the prior of the next one."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from onlinebayes.cli.main import main
from onlinebayes.criticism import Criticism, Scope, compare, next_unit, worlds_of
from onlinebayes.criticism.findings.fleets import fleets_of
from onlinebayes.identification.replaying.scoped import ScopedSimulator, effect_entries
from onlinebayes.inference import saving
from onlinebayes.measurements import Measurement, concatenate
from onlinebayes.parameters import Parameter
from onlinebayes.problems import load_problem
from onlinebayes.report import phrases, write_report
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ConstantLoad
from tests.criticism.rigs import FREE, SLIDE, measure, model

MASS, DAMPING = FREE.names
DAMPINGS = (1.0, 1.6, 1.3, 1.9, 1.15)
"""Of five units; mean 1.39, sd 0.37."""

UNITS = {f"cart {k}": (f"c{k}-*",) for k in range(5)}
SCOPE = Scope(per_unit=(DAMPING,), units=UNITS)
HELD_OUT = [f"c{k}-2" for k in range(5)]


def carts(dampings: tuple[float, ...] = DAMPINGS, runs: int = 3) -> Measurement:
    """Each unit's runs, of one mass and the unit's own damping."""
    parts = []
    for k, damping in enumerate(dampings):
        one = measure(runs=runs, seconds=3.0, seed=20 * k, truth=(2.5, damping))
        parts.append(replace(one, runs=tuple(f"c{k}-{r}" for r in range(runs))))
    return concatenate(parts)


@pytest.fixture(scope="module")
def log() -> Measurement:
    return carts()


@pytest.fixture(scope="module")
def answer(log: Measurement) -> Criticism:
    return compare(model(), log, holdout=HELD_OUT, scope=SCOPE)


def test_five_units_are_told_apart_and_said_together(answer: Criticism) -> None:
    assert list(answer.parameters) == [MASS, *(f"{DAMPING}[unit cart {k}]" for k in range(5))]
    (fleet,) = answer.fleet.values()
    assert list(answer.fleet) == [DAMPING]
    assert list(fleet.units) == [f"cart {k}" for k in range(5)]
    # Two runs a unit: without what all units say of the error one of them would be 7.6 of its sds off by chance.
    for k, damping in enumerate(DAMPINGS):
        value = answer.parameters[f"{DAMPING}[unit cart {k}]"]
        assert abs(value.mean - damping) < 4 * value.sd < 0.02
        assert abs(fleet.units[f"cart {k}"].mean - damping) < 4 * value.sd
    # The errors are a hundredth of the spread: mean and spread are the truths' own.
    truths = torch.tensor(DAMPINGS, dtype=torch.float64)
    assert fleet.mean.mean == pytest.approx(float(truths.mean()), abs=0.02)
    assert fleet.spread.mean == pytest.approx(float(truths.std()), abs=0.02)
    assert fleet.next.q95 == pytest.approx(float(truths.mean() + 2.132 * truths.std() * 1.2**0.5), abs=0.05)
    assert fleet.mean.unit == "N s/m"


def test_a_held_out_run_of_a_unit_is_judged_with_the_units_value(answer: Criticism) -> None:
    error, floor = answer.heldout_error.after["qpos.rail"], answer.heldout_error.noise_floor["qpos.rail"]
    assert error < 1.2 * floor


def test_the_next_unit_has_a_prior_that_can_be_kept(answer: Criticism, tmp_path: Path) -> None:
    belief, fleet = next_unit(answer), answer.fleet[DAMPING]
    assert belief.space.names == FREE.names
    drawn = belief.sample((4000,), torch.Generator().manual_seed(0))
    low, high = drawn[:, 1].quantile(torch.tensor([0.05, 0.95], dtype=torch.float64)).tolist()
    assert low == pytest.approx(fleet.next.q05, abs=0.06)  # five standard errors of 4000 draws
    assert high == pytest.approx(fleet.next.q95, abs=0.06)
    assert float(drawn[:, 0].std()) == pytest.approx(answer.parameters[MASS].sd, rel=0.1)
    assert bool(torch.isfinite(belief.log_prob(drawn)).all())
    saving.save(belief, tmp_path / "next.json")
    kept = saving.load(tmp_path / "next.json", model().parameters)
    assert torch.equal(kept.log_prob(drawn), belief.log_prob(drawn))
    worlds = worlds_of(answer)
    assert float(worlds.covariance[0, 1, 1].sqrt()) == pytest.approx(fleet.next.sd)


def test_the_report_says_it(answer: Criticism, tmp_path: Path) -> None:
    files = write_report(answer, tmp_path)
    assert "next_unit.json" in files
    found = json.loads((tmp_path / "report.json").read_text())["fleet"][DAMPING]
    assert set(found) == {"mean", "spread", "next", "units", "left_out"}
    assert found["units"]["cart 3"]["mean"] == pytest.approx(1.9, abs=0.02)
    page = (tmp_path / "report.html").read_text()
    assert "From unit to unit" in page
    assert "unit cart 3" in page


def test_a_unit_that_is_not_determined_is_left_out_and_bounds_cut(answer: Criticism) -> None:
    final, name = answer.final, f"{DAMPING}[unit cart 1]"
    vague = replace(final.parameters[name], identifiable=False)
    narrow = final.simulator.with_bounds(DAMPING, Parameter(0.9, 2.0, "N s/m"))
    fleet = fleets_of(replace(final, simulator=narrow, parameters={**final.parameters, name: vague}))[DAMPING]
    assert fleet.left_out == ("cart 1",)
    assert list(fleet.units) == [f"cart {k}" for k in (0, 2, 3, 4)]
    assert (fleet.next.q05, fleet.next.q95) == (0.9, 2.0)
    assert "of 4 units (cart 1 not determined)" in phrases.fleet(DAMPING, fleet)


def test_without_units_nothing_is_said(answer: Criticism) -> None:
    with pytest.raises(BadInput, match="no parameter's spread between units is known"):
        next_unit(replace(answer, fleet={}))


@pytest.mark.slow
def test_several_parameters_each_their_own(log: Measurement) -> None:
    known = {"c4-*": {MASS: 2.5, DAMPING: DAMPINGS[4]}}  # nothing of this unit is fitted
    scope = replace(SCOPE, per_unit=(MASS, DAMPING), known=known)
    found = compare(model(), log, holdout=HELD_OUT, scope=scope)
    assert list(found.fleet[MASS].units) == [f"cart {k}" for k in range(4)]
    assert list(found.fleet) == [MASS, DAMPING]
    assert found.fleet[MASS].mean.mean == pytest.approx(2.5, abs=0.01)
    assert found.fleet[MASS].spread.mean < 0.01  # one mass was in all of them
    assert found.fleet[DAMPING].spread.mean > 0.3
    assert next_unit(found).space.names == FREE.names


def test_units_and_runs_beside_each_other(log: Measurement) -> None:
    simulator = ScopedSimulator(model(), replace(SCOPE, per_run=(MASS,)), ["c0-0", "c0-1", "c1-0"])
    assert simulator.parameters.names == (
        *(f"{MASS}[run {run}]" for run in ("c0-0", "c0-1", "c1-0")),
        f"{DAMPING}[unit cart 0]",
        f"{DAMPING}[unit cart 1]",
    )
    phi = torch.tensor([1.0, 2.0, 3.0, 0.5, 0.7], dtype=torch.float64)
    theta = {run: simulator.affine(run)[0] @ phi for run in ("c0-1", "c0-1 (first half)", "c1-0", "c1-1")}
    assert [at.tolist() for at in theta.values()] == [[2.0, 0.5], [2.0, 0.5], [3.0, 0.7], [2.0, 0.7]]
    assert (simulator.free_in("c1-1"), simulator.free_in("c2-0")) == ((MASS,), (MASS, DAMPING))


def test_an_effect_has_one_size_a_unit() -> None:
    load = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
    scoped = ScopedSimulator(model(), Scope(per_unit=(load.key,), units=UNITS), ["c0-0", "c0-1", "c1-0"])
    entries = {f"constant_load@rail.load[unit cart {k}]": "load" for k in (0, 1)}
    assert effect_entries(scoped, load) == entries
    assert scoped.with_effect(load).parameters.names == (MASS, DAMPING, *entries)


def test_a_run_without_a_unit_is_a_unit_of_its_own() -> None:
    scope = Scope(per_unit=(DAMPING,), units={"a": ("c0-*",)})
    assert [scope.owner(DAMPING, run) for run in ("c0-0", "c0-1 (first half)", "c1-0")] == ["a", "a", "c1-0"]
    scope.check_units(["c0-0", "c1-0"])


@pytest.mark.parametrize(
    ("scope", "message"),
    [
        (Scope(per_unit=("joint.rial.damping",), units=UNITS), "'joint.rial.damping' is no parameter of the simulator"),
        (Scope(per_unit=(DAMPING,), units={"all": ("c*",)}), "tell it of one unit alone, 'all'"),
        (Scope(per_unit=(DAMPING,), units=UNITS, known={"*": {DAMPING: 1.0}}), "of no unit, for it is known in every"),
        (Scope(per_unit=(DAMPING,), units={"a": ("c0-*",), "b": ("c?-1",)}), "run 'c0-1' is of the units 'a' and 'b'"),
        (Scope(per_unit=(DAMPING,), units={"a": ("d0-*",), "b": ("c?-1",)}), "no run is called 'd0-*'"),
    ],
)
def test_bad_units(log: Measurement, scope: Scope, message: str) -> None:
    with pytest.raises(BadInput, match=re.escape(message)):
        compare(model(), log, holdout=HELD_OUT, scope=scope)


def written(folder: Path, log: Measurement, units: str, more: str = "") -> Path:
    """The problem of these units as files."""
    (folder / "slide.xml").write_text(SLIDE)
    rows = ["run,time,ctrl.motor,qpos.rail"]
    for r, run in enumerate(log.runs):
        parts = (log.data["time"][r], log.data["command"][r, :, 0], log.data["signal"][r, :, 0])
        rows += [f"{run},{t:.2f},{u:.9g},{q:.9g}" for t, u, q in zip(*(x.tolist() for x in parts), strict=True)]
    (folder / "carts.csv").write_text("\n".join(rows) + "\n")
    path = folder / "carts.toml"
    path.write_text(
        f"""model = "slide.xml"
measurements = ["carts.csv"]
holdout = ["c?-2"]
{units}
[parameters]
"{MASS}" = [0.5, 8.0]
"{DAMPING}" = {{ low = 0.0, high = 10.0, scope = "per_unit" }}
{more}"""
    )
    return path


@pytest.mark.slow
def test_the_command_line_says_it_and_its_files_go_on(log: Measurement, tmp_path: Path, capsys) -> None:
    path = written(tmp_path, log, 'units = ["c0-*", "c1-*", "c2-*", "c3-*", "c4-*"]')
    assert main(["refine", str(path), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert re.search(r"units: +joint.rail.damping: 1.39 N s/m on average of 5\s+units, spread 0.3", said)
    assert "next_unit.json" in said
    again = load_problem(tmp_path / "out" / "refined.toml")
    assert again.scope == Scope(per_unit=(DAMPING,), units={f"c{k}-*": (f"c{k}-*",) for k in range(5)})
    assert "unit c3-* 1.9" in (tmp_path / "out" / "refined.toml").read_text()
    belief = saving.load(tmp_path / "out" / "next_unit.json", again.simulator.parameters)
    assert 1.2 < float(belief.sample((1000,), torch.Generator().manual_seed(0))[:, 1].median()) < 1.6


def test_units_by_name_in_a_table(log: Measurement, tmp_path: Path) -> None:
    path = written(tmp_path, log, "", '[units]\n"first" = "c0-*"\n"the others" = ["c1-*", "c[234]-*"]\n')
    scope = load_problem(path).scope
    assert scope is not None
    assert scope.units == {"first": ("c0-*",), "the others": ("c1-*", "c[234]-*")}
    assert tomllib.loads(path.read_text())["units"]["first"] == "c0-*"


@pytest.mark.parametrize(
    ("units", "more", "message"),
    [
        ('units = ["c*"]', "", "carts.toml: units: .* one unit alone, 'c\\*'; name runs of two units or more"),
        ('units = ["c0-*", "c0-*"]', "", "carts.toml: units: 'c0-\\*' stands twice; name it once"),
        ('units = ["c0-*", "c?-1"]', "", "carts.toml: units: run 'c0-1' is of the units 'c0-\\*' and 'c\\?-1'"),
        ("", '[units]\n"a" = "c0-*"\n"a" = "c1-*"', "carts.toml: is not TOML: Cannot overwrite a value"),
        ("", '[units]\n"a" = []', "units.a: no run is named"),
        ("", '[units]\n"a" = 3', "units.a: 3 is not a list"),
        ("", '[effects.scope]\n"dry_friction@rial" = "per_unit"', "no joint 'rial' for dry_friction; nearest: rail"),
        ("", f'[runs."*"]\n"{DAMPING}" = 1.0', "is per unit, and .* of no unit, for it is known in every run"),
    ],
)
def test_one_clear_line(log: Measurement, tmp_path: Path, capsys, units: str, more: str, message: str) -> None:
    path = written(tmp_path, log, units, more)
    assert main(["compare", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert re.search(message, said), said
    assert said.count("\n") == 1


def test_units_of_nothing(log: Measurement, tmp_path: Path, capsys) -> None:
    path = written(tmp_path, log, 'units = ["c0-*", "c1-*"]')
    path.write_text(path.read_text().replace(', scope = "per_unit"', ""))
    assert main(["compare", str(path), "--out", str(tmp_path / "out")]) == 2
    assert 'units: nothing is per unit; give a parameter or an effect the scope "per_unit"' in capsys.readouterr().err
