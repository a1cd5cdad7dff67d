"""Whatever is wrong with the input: status 2, one line that says what and what to do, no traceback, nothing written."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from onlinebayes.cli.main import main
from tests.problems.conftest import PROBLEM


def edit(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return change


def problem(old: str, new: str) -> Callable[[Path], None]:
    return edit("carriage.toml", old, new)


def table(old: str, new: str) -> Callable[[Path], None]:
    return edit("carriage.csv", old, new)


def more(text: str) -> Callable[[Path], None]:
    return problem(PROBLEM, PROBLEM + text)


def content(name: str, what: bytes) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes(what) and None


def blank(run: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        lines = (folder / "carriage.csv").read_text().splitlines()
        lines = [line.rpartition(",")[0] + "," if line.startswith(run + ",") else line for line in lines]
        (folder / "carriage.csv").write_text("\n".join(lines))

    return change


def hook(*blank: str) -> Callable[[Path], None]:
    """A second joint, with an empty cell in every row of these runs."""

    def change(folder: Path) -> None:
        model = (folder / "carriage.xml").read_text()
        body = '<body name="hook"><joint name="hook" axis="0 1 0"/><geom size=".1" pos="0 0 -1"/></body>'
        (folder / "carriage.xml").write_text(model.replace("</body>", f"{body}</body>"))
        head, *rows = (folder / "carriage.csv").read_text().splitlines()
        rows = [f"{row},{'' if row.split(',')[0] in blank else 0.1}" for row in rows]
        (folder / "carriage.csv").write_text("\n".join([f"{head},qpos.hook", *rows]))

    return change


def milliseconds(folder: Path) -> None:
    rows = [line.split(",") for line in (folder / "carriage.csv").read_text().splitlines()]
    rows = [rows[0]] + [[run, f"{float(t) * 1000:g}", *rest] for run, t, *rest in rows[1:]]
    (folder / "carriage.csv").write_text("\n".join(",".join(row) for row in rows))


def bytes_of_latin(folder: Path) -> None:
    raw = (folder / "carriage.csv").read_bytes()
    (folder / "carriage.csv").write_bytes(raw.replace(b"first,0.05", b"f\xefrst,0.05"))


BAD: dict[str, tuple[Callable[[Path], object], str]] = {
    # the problem file
    "no problem file": (lambda f: (f / "carriage.toml").unlink(), "carriage.toml: no such file"),
    "a folder": (lambda f: ((f / "carriage.toml").unlink(), (f / "carriage.toml").mkdir()), "is a folder"),
    "syntax": (problem("schema = 1", "schema 1"), "is not TOML: .*line 2"),
    "latin toml": (content("carriage.toml", b'schema = 1\nmodel = "\xe9"'), "line 2: the file is not UTF-8"),
    "empty toml": (content("carriage.toml", b""), "'measurements' is missing"),
    "nested": (content("carriage.toml", b"a = " + b"[" * 20000), "is not TOML"),
    "a number too long": (more("[selection]\nhorizon_s = 1" + "0" * 400), "selection.horizon_s: inf is not finite"),
    "a number far too long": (more("[selection]\nhorizon_s = 1" + "0" * 5000), "is not TOML"),
    "schema": (problem("schema = 1", "schema = 2"), "schema: version 2 is unknown"),
    "unknown key": (problem("holdout", "holdouts"), "carriage.toml: holdouts: unknown key; nearest: holdout"),
    "unknown inner key": (more("[selection]\nhorizon = 1"), "selection.horizon: unknown key; nearest: horizon_s"),
    "unknown parameter key": (problem("[1.0, 10.0]", "{ low = 1, hi = 2 }"), 'mass".hi: unknown key; nearest: high'),
    "unknown signal key": (more('[signals."qpos.carriage"]\nsdd = 1'), "sdd: unknown key; nearest: sd"),
    "no model": (problem('model = "carriage.xml"', ""), "'model' is missing"),
    "no measurements": (problem('measurements = ["carriage.csv"]', ""), "'measurements' is missing"),
    "measurements text": (problem('["carriage.csv"]', '"carriage.csv"'), "measurements: 'carriage.csv' is not a list"),
    "measurements none": (problem('["carriage.csv"]', "[]"), "measurements: no table is named"),
    "no parameters": (problem("[parameters]", "[selection]"), "selection.*unknown key"),
    "empty parameters": (content("carriage.toml", PROBLEM.split("[param")[0].encode()), r"\[parameters\] is missing"),
    "reversed": (problem("[1.0, 10.0]", "[10.0, 1.0]"), "mass.*reversed"),
    "equal bounds": (problem("[1.0, 10.0]", "[1.0, 1.0]"), "mass.*reversed or empty"),
    "infinite bound": (problem("[1.0, 10.0]", "[1.0, inf]"), "mass.*inf is not finite"),
    "text bound": (problem("[1.0, 10.0]", '["1.0", 10.0]'), "low: '1.0' is not a number"),
    "true bound": (problem("[1.0, 10.0]", "[true, 10.0]"), "True is not a number"),
    "one bound": (problem("[1.0, 10.0]", "[1.0]"), "no pair of bounds"),
    "three bounds": (problem("[1.0, 10.0]", "[1.0, 2.0, 3.0]"), "no pair of bounds"),
    "no high": (problem("[1.0, 10.0]", "{ low = 1.0 }"), "a bound is missing"),
    "scale": (problem("[1.0, 10.0]", "{ low = 1, high = 2, scale = 'ln' }"), "mass.*scale 'ln' is unknown"),
    "log of zero": (problem("[1.0, 10.0]", "{ low = 0, high = 2, scale = 'log' }"), "log scale cannot start at 0"),
    "bounds in a table": (problem("[1.0, 10.0]", "{ bounds = [1, 10] }"), "bounds: unknown key; known: low, high"),
    "address without quotes": (
        problem('"body.carriage.mass"', "body.carriage.mass"),
        'body: an address .* write "body.carriage.mass" =',
    ),
    "signal without quotes": (more("[signals.qpos.carriage]\nsd = 1"), 'signals.qpos: .* write "qpos.carriage"'),
    "holdout text": (problem('["second"]', '"second"'), r"holdout: 'second' is not a list; write \["),
    "tie": (problem("[1.0, 10.0]", "{ low = 1, high = 2, tie = true }"), "tie: a single address has nothing"),
    "tie text": (problem("[1.0, 10.0]", "{ low = 1, high = 2, tie = 'yes' }"), "tie: 'yes' is not true or false"),
    "glob": (
        problem("body.carriage.mass", "body.carrage*.mass"),
        "no body that matches .*; nearest: carriage",
    ),
    "glob field": (problem("body.carriage.mass", "body.*.weight"), "a body has no field 'weight'"),
    "glob kind": (problem("body.carriage.mass", "bodi.*.mass"), "'bodi.\\*.mass' is malformed"),
    "glob twice": (problem('"body.carriage.mass"', '"body.c*.mass" = [1, 2]\n"body.*e.mass"'), "is matched twice"),
    "glob and tie": (
        problem('"body.carriage.mass"', '"body.c*.mass" = { low = 1, high = 2, tie = true }\n"body.carriage.mass"'),
        "'body.carriage.mass' are the same value|'body.c\\*.mass' are the same value",
    ),
    "scope": (problem("[1.0, 10.0]", "{ low = 1, high = 2, scope = 'per run' }"), "scope: scope 'per run' is unknown"),
    "runs": (more('[runs."a*"]\n"body.carriage.mass" = 1'), "runs: no run is called 'a\\*'; known: first, second"),
    "runs address": (more('[runs."*"]\n"body.carrige.mass" = 1'), "no body 'carrige'; nearest: carriage"),
    "runs text": (more('[runs.first]\n"body.carriage.mass" = "1"'), "'1' is not a number"),
    "runs without quotes": (more("[runs.first]\nbody.carriage.mass = 1"), 'write "body.carriage.mass" = value'),
    "runs empty": (more("[runs.first]"), "runs.first: nothing is known"),
    "runs twice": (
        more('[runs.first]\n"body.carriage.mass" = 1\n[runs."f*"]\n"body.carriage.mass" = 2'),
        "run 'first' has two values of 'body.carriage.mass', 1 and 2",
    ),
    "runs effect": (
        more('[runs.first]\n"dry_frict@carriage.frictionloss" = 1'),
        "effect 'dry_frict' is unknown",
    ),
    "runs effect without parameter": (
        more('[runs.first]\n"dry_friction@carriage" = 1'),
        "'dry_friction@carriage' names no parameter; write effect@target.parameter",
    ),
    "groups": (
        problem(
            "[parameters]",
            'groups = ["x*"]\n[parameters]\n"joint.carriage.armature" = { low = 0, high = 1, scope = "per_run" }',
        ),
        r"carriage.toml: groups: no run is called 'x\*'",
    ),
    "clock": (more('[time]\ncolumn = "tick"'), "row 1: no column 'tick'"),
    "clock key": (more("[time]\nlatency = 1"), "time.latency: unknown key; known: column, unit"),
    "clock unit": (more('[time]\nunit = "mm"'), "time.unit: unit 'mm' cannot become s; use one of s, ms, us, ns"),
    "latency of hours": (
        more('[signals."qpos.carriage"]\nlatency = 9000'),
        r'signals."qpos.carriage".latency: with 9000 s no row',
    ),
    "latency": (more('[signals."qpos.carriage"]\nlatency = "1 ms"'), "latency: '1 ms' is not a number"),
    "weld": (more("[model_edit]\nweld = ['carrige']"), "model_edit.weld: .*no body 'carrige'; nearest: carriage"),
    "weld driven": (
        more("[model_edit]\nweld = ['carriage']"),
        "carriage.toml: parameters.\"joint.carriage.damping\": the model has no joint 'carriage'; known: none$",
    ),
    "timestep": (more("[model_edit]\ntimestep = 0"), "timestep: 0 s is no step"),
    "integrator": (more("[model_edit]\nintegrator = 'rk4'"), "'rk4' is unknown; use Euler, RK4"),
    "edit": (more("[model_edit]\nwelds = []"), "welds: unknown key; nearest: weld"),
    "actuator": (more("[actuators.moter]\ninput = 'force'"), "no actuator 'moter'; nearest: motor"),
    "input": (
        more("[actuators.motor]\ninput = 'position'"),
        "takes a force or voltage, not a position",
    ),
    "input word": (more("[actuators.motor]\ninput = 'torque'"), "'torque' is unknown; use force, voltage"),
    "compensation": (more("[actuators.motor]\ngravity_compensation = 1"), "1 is not true or false"),
    "effect scope": (more('[effects.scope]\n"dry_friction@carriage" = "each"'), "scope 'each' is unknown"),
    "effect scope target": (more('[effects.scope]\n"dry_friction@wheel" = "per_run"'), "no joint 'wheel'"),
    "effect scope name": (more('[effects.scope]\n"dry_friction" = "per_run"'), "write effect@target"),
    "address body": (problem("body.carriage.mass", "body.carrige.mass"), "no body 'carrige'; nearest: carriage"),
    "address field": (problem("carriage.mass", "carriage.weight"), "no field 'weight'"),
    "address kind": (problem("body.carriage.mass", "bodi.carriage.mass"), "starts with 'bodi'"),
    "holdout": (problem("second", "third"), "holdout: no run is called 'third'; the tables have first, second"),
    "holdout of what is excluded": (
        problem('holdout = ["second"]', 'exclude = ["second"]\nholdout = ["second"]'),
        "holdout: 'second' is left out by 'exclude'; name runs that are left in",
    ),
    "holdout all": (problem('["second"]', '["*"]'), "holdout: every run is held out"),
    "holdout none": (problem('["second"]', "[]"), "holdout: no run is named"),
    "sd": (more('[signals."qpos.carriage"]\nsd = -1'), "sd = -1.0 is not a positive number"),
    "signal": (more('[signals."qpos.carrige"]\nsd = 1'), "unknown key; nearest: qpos.carriage"),
    "signal unit": (more('[signals."qpos.carriage"]\nunit = "deg"'), "unit 'deg' cannot become m; use one of m, cm"),
    "signal column": (
        more('[signals."qpos.carriage"]\ncolumn = "x"'),
        "no column 'x', which .* names; the columns are 'ctrl",
    ),
    "alpha": (more("[selection]\nalpha = 3"), "selection.alpha: 3.0 is out of range; .*between 0 and 1"),
    "folds": (more("[selection]\nfolds = 1.5"), "selection.folds: 1.5 is not a whole number"),
    "horizon": (more("[selection]\nhorizon_s = nan"), "selection.horizon_s: nan is not finite"),
    "candidate": (more("[effects]\ncandidates = ['dry_fricton']"), "'dry_fricton' is unknown; nearest: dry_friction"),
    "candidate all": (
        more("[effects]\ncandidates = ['all']"),
        "'all' is no effect; write candidates = \"all\", without",
    ),
    "candidate target": (more("[effects]\ncandidates = ['dry_friction@motor']"), "no joint 'motor' for dry_friction"),
    "candidates text": (more("[effects]\ncandidates = 'dry_friction'"), "effects.candidates: .*is no list"),
    "add": (more("[effects]\nadd = ['dry_friction']"), "effects.add: 'dry_friction' names no target"),
    "add target": (more("[effects]\nadd = ['actuator_delay@moto']"), "no actuator 'moto' .*nearest: motor"),
    "module": (more("[effects]\nmodules = ['no_such_thing']"), "effects.modules: module 'no_such_thing' cannot be"),
    "command": (more('[commands.moto]\ncolumn = "u"'), "commands.moto: unknown key; nearest: motor"),
    "command key": (more("[commands.motor]\nsd = 1"), "commands.motor.sd: unknown key; known: column, unit"),
    "command unit": (more('[commands.motor]\nunit = "volt"'), "commands.motor.unit: unit 'volt' is unknown"),
    "command sign": (more("[commands.motor]\nsign = 2"), "commands.motor.sign: 2.0 is no sign"),
    "command scale": (more("[commands.motor]\nscale = 0"), "commands.motor.scale: 0 would erase it"),
    "command column": (more('[commands.motor]\ncolumn = "u"'), "no column 'u', the command of the model's actuator"),
    "dots": (more("a" + ".a" * 100_000 + " = 1"), "a line of more than 2000 dots"),
    "deep keys": (more("[parameters" + ".a" * 1900 + "]\nb = 1"), "carriage.toml"),
    "huge toml": (content("carriage.toml", b"#" * 2_000_000), "more than 1048576 bytes"),
    "NUL path": (problem('"carriage.csv"', '"a\\u0000b"'), "measurements|no such file"),
    "NUL model": (problem('"carriage.xml"', '"a\\u0000b"'), "model: no such file"),
    # the model
    "model reaches out": (
        edit("carriage.xml", "<worldbody>", '<include file="../outside.xml"/><worldbody>'),
        "model: .*outside the folder",
    ),
    "model file": (problem("carriage.xml", "wagon.xml"), "model: no such file: .*wagon.xml"),
    "model broken": (edit("carriage.xml", "<body", "<bod"), "does not compile"),
    "model not XML": (content("carriage.xml", b"\x89PNG\r\n"), "does not compile"),
    "model nan": (edit("carriage.xml", 'damping="2"', 'damping="nan"'), "model: its own joint.carriage.damping is nan"),
    "model empty": (content("carriage.xml", b""), "does not compile"),
    "factory module": (problem("carriage.xml", "no_such_rig:build"), "module 'no_such_rig' cannot be imported"),
    # the table
    "no table": (lambda f: (f / "carriage.csv").unlink(), "carriage.csv: no such file"),
    "table empty": (content("carriage.csv", b""), "carriage.csv: the file is empty"),
    "header only": (content("carriage.csv", b"run,time,ctrl.motor,qpos.carriage\n"), "a header and no rows"),
    "one row": (content("carriage.csv", b"time,ctrl.motor,qpos.carriage\n0,0,0\n"), "row 2: a run of 1 row"),
    "latin": (bytes_of_latin, "row 7, byte 0xef: the file is not UTF-8"),
    "binary": (content("carriage.csv", bytes(range(256))), "not UTF-8"),
    "joint": (table("qpos.carriage", "qpos.carrige"), "column 'qpos.carrige': .*nearest: qpos.carriage"),
    "wrong column": (table("time", "t"), "row 1: no column 'time'"),
    "duplicate column": (table("ctrl.motor,qpos.carriage", "ctrl.motor,ctrl.motor"), "two columns are called"),
    "ragged": (table("first,0.03,", "first,0.03,0,"), "row 5: 5 cells where the header has 4"),
    "no file": (problem('["carriage.csv"]', '["/dev/zero"]'), "/dev/zero: is not a file"),
    "too large": (
        table("first,0.05,", "first,0.05,1e300,0\nfirst,0.055,"),
        "row 7, column 'ctrl.motor': 1e.300 is too",
    ),
    "nothing measured": (blank("first"), r"the fit runs \(first\) have no measured value of qpos.carriage"),
    "nothing held out": (blank("second"), r"the held-out runs \(second\) have no measured value"),
    "joint not measured in a run": (
        hook("second"),
        "carriage.toml: run 'second': joint 'hook' has no measured position: no cell of qpos.hook",
    ),
    "joint not measured at all": (
        hook("first", "second"),
        "carriage.toml: joint 'hook' has no measured position or velocity; add the column qpos.hook",
    ),
    "time of day": (table("first,0.05,", "first,12:00:05,"), "row 7, column 'time': '12:00:05' .* write seconds"),
    "time goes back": (table("first,0.05,", "first,0.01,"), "row 7, column 'time': time goes from 0.04 to 0.01"),
    "duplicate time": (table("first,0.05,", "first,0.04,"), "row 7, column 'time': time goes from 0.04 to 0.04"),
    "inf": (table("first,0.05,", "first,inf,"), "row 7, column 'time': inf"),
    "nan command": (table("first,0.00,0.000000", "first,0.00,nan"), "row 2, column 'ctrl.motor': a command cannot be"),
    "no command": (table("ctrl.motor", "meta.motor"), "row 1: no column 'ctrl.motor'"),
    "run twice": (table("first,0.50,", "other,0.50,"), "row 53, column 'run': run 'first' begins again"),
    "table twice": (
        problem('["carriage.csv"]', '["carriage.csv", "./carriage.csv"]'),
        "carriage.csv: run 'first' is given twice",
    ),
    "milliseconds": (milliseconds, r'has a row every 10 s, .*\[time\] unit = "ms"'),
    "nanoseconds since 1970": (
        table("first,0.00,", "first,1700000000000000000,"),
        r"row 2, column 'time': 1.7e\+18 is too large .*\[time\] unit = \"ns\"",
    ),
    "packed": (
        content("carriage.csv", b"\x1f\x8b\x08\x00 run,time"),
        "the file is packed by gzip; give the table in it",
    ),
    "a workbook": (
        content("carriage.csv", b"PK\x03\x04 run,time"),
        "the file is a ZIP archive .* give the table in it",
    ),
    "runs as a signal": (more('[signals."qpos.carriage"]\ncolumn = "run"'), "column 'run': 'run' names the runs"),
    "runs as a command": (more('[commands.motor]\ncolumn = "run"'), "column 'run': 'run' names the runs"),
    "runs as a factor": (more('[commands.motor]\ntimes = "run"'), "column 'run': 'run' names the runs"),
    "runs as the clock": (more('[time]\ncolumn = "run"'), "column 'run': 'run' names the runs"),
    "an escape in a name": (table("ctrl.motor", "ctrl.\x1b[31m"), r"column 'ctrl.\\x1b\[31m'"),
    "a star in a name": (
        lambda f: [
            edit("carriage.xml", 'body name="carriage"', 'body name="c*"')(f),
            problem("body.carriage.mass", "body.*.mass")(f),
        ],
        r"body 'c\*' has \* or \? in its name, .* give the body another name",
    ),
    "parquet": (problem("carriage.csv", "carriage.toml"), "carriage.toml"),
}


def one_line(captured: str, folder: Path) -> str:
    lines = captured.splitlines()
    errors = [line for line in lines if line.startswith("onlinebayes: error: ")]
    assert len(errors) == 1, captured
    assert lines[-1] == errors[0]
    assert all(line.startswith("onlinebayes: ") for line in lines), captured
    assert not (folder / "out").exists()
    return errors[0]


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_status_2(folder, capsys, name):
    change, message = BAD[name]
    (folder.parent / "outside.xml").write_text("<mujoco/>")
    change(folder)
    before = sorted(folder.rglob("*"))
    assert main(["refine", str(folder / "carriage.toml"), "--out", str(folder / "out" / "deep")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert re.search(message, one_line(captured.err, folder)), captured.err
    assert [p for p in sorted(folder.rglob("*")) if "__pycache__" not in p.parts] == before


def test_an_out_folder_that_is_a_file(folder, capsys):
    (folder / "taken").write_text("mine")
    for out in ("taken", "taken/deeper"):
        assert main(["compare", str(folder / "carriage.toml"), "--out", str(folder / out)]) == 2
        assert "taken" in one_line(capsys.readouterr().err, folder)
    assert (folder / "taken").read_text() == "mine"


@pytest.mark.parametrize("name", ["report.json", "run.rrd", "refined.toml"])
def test_an_out_folder_with_a_folder_in_a_files_place(folder, capsys, name):
    (folder / "there" / name).mkdir(parents=True)
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(folder / "there")]) == 2
    assert f"{name}: is a folder, where a file is to be written" in one_line(capsys.readouterr().err, folder)
    assert [path.name for path in (folder / "there").iterdir()] == [name]


def test_an_out_folder_that_may_not_be_written(folder, capsys):
    locked = folder / "locked"
    locked.mkdir(mode=0o500)
    if os.access(locked, os.W_OK):
        locked = Path("/proc/onlinebayes")  # whoever may write everywhere still cannot write there
        if not Path("/proc").is_dir():
            pytest.skip("this user may write everywhere")
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(locked)]) == 2
    assert "cannot be written" in one_line(capsys.readouterr().err, folder)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "the following arguments are required: COMMAND"),
        (["refine"], "required: --out"),
        (["refine", "--out", "o"], "required: problem"),
        (["refine", "--out", "o", "--add", "a.toml", "b.toml"], "give one problem file, or a model"),
        (["refine", "x.toml"], "required: --out"),
        (["refin", "x.toml", "--out", "o"], "invalid choice: 'refin'"),
        (["compare", "x.toml", "--out", "o", "--seed", "1"], "unrecognized arguments"),
        (["compare", "x.toml", "--out", "o", "--add"], "--add"),
        (["compare", "x.toml", "--out", ""], "--out: it is empty"),
        (["init", "x.xml", "x.csv", "--out", " "], "--out: it is empty"),
    ],
)
def test_bad_arguments(capsys, arguments, message):
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize(
    ("add", "message"),
    [
        ("dry_friction", "--add: 'dry_friction' names no target"),
        ("dry_friction@wheel", "--add: the model has no joint 'wheel'"),
        ("glue@carriage", "--add: effect 'glue' is unknown"),
        ("@", "--add: effect '' is unknown"),
    ],
)
def test_effects_added_by_hand_are_checked(folder, capsys, add, message):
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(folder / "out"), "--add", add]) == 2
    assert message in one_line(capsys.readouterr().err, folder)


def test_the_problem_may_stand_behind_the_effects(folder, capsys):
    arguments = ["compare", "--add", "glue@carriage", str(folder / "carriage.toml"), "--out", str(folder / "out")]
    assert main(arguments) == 2
    assert "--add: effect 'glue' is unknown" in one_line(capsys.readouterr().err, folder)


def test_show_of_a_folder_without_a_report(folder, capsys):
    assert main(["show", str(folder)]) == 2
    assert "holds none of report.html" in one_line(capsys.readouterr().err, folder)
    assert main(["show", str(folder / "nowhere")]) == 2
    assert "no such folder" in one_line(capsys.readouterr().err, folder)


@pytest.mark.parametrize("arguments", [["compare", "none.toml", "--out", "out"], ["compare", "carriage.toml"]])
def test_the_installed_command(folder, arguments):
    """The console script itself, in the folder of the problem, as a user calls it."""
    script = Path(sys.executable).with_name("onlinebayes")
    done = subprocess.run([script, *arguments], cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("onlinebayes")
