"""One run in several tables, each with some of its columns and a clock of its own, is the run of one table."""

from pathlib import Path

import numpy as np
import pytest
import torch

from onlinebayes.measurements import CommandColumn, Measurement, Signal, SignalColumn, TableReader, TimeColumn
from onlinebayes.runs import BadInput

COMMANDS = "run,time,ctrl.motor\na,0,1\na,0.25,2\na,0.9,3\nb,5,-1\n"
ANGLES = "run,time,qpos.carriage,meta.seq\nb,5,0.5,1\nb,5.1,0.6,2\na,0,0,3\na,0.1,0.1,4\na,0.25,0.2,5\na,0.3,0.3,6\n"
TOGETHER = (
    "run,time,ctrl.motor,qpos.carriage\n"
    "a,0,1,0\na,0.1,,0.1\na,0.25,2,0.2\na,0.3,,0.3\na,0.9,3,\n"
    "b,5,-1,0.5\nb,5.1,,0.6\n"
)


def read(folder: Path, notes: list[str] | None = None, **texts: str) -> Measurement:
    for name, text in texts.items():
        (folder / f"{name}.csv").write_text(text)
    reader = TableReader(
        signals=[Signal("qpos.carriage", "m"), Signal("qvel.carriage", "m/s")],
        commands=["motor"],
        note=(lambda _line: None) if notes is None else notes.append,
    )
    return reader.read([folder / f"{name}.csv" for name in texts])


def same(one: Measurement, other: Measurement) -> None:
    assert (one.runs, one.signals, one.commands) == (other.runs, other.signals, other.commands)
    for key in ("time", "command", "enable", "signal", "measured", "mask"):
        assert torch.equal(one.data[key], other.data[key]), key


@pytest.mark.parametrize("order", [("commands", "angles"), ("angles", "commands")])
def test_commands_in_one_table_and_angles_in_another(tmp_path: Path, order: tuple[str, str]) -> None:
    texts, notes = {"commands": COMMANDS, "angles": ANGLES}, list[str]()
    found = read(tmp_path, notes, **{name: texts[name] for name in order})
    same(found.select(["a", "b"]), read(tmp_path, together=TOGETHER))
    where = " + ".join(str(tmp_path / f"{name}.csv") for name in order)
    assert notes == [f"{where}: joined by 'time', for they share runs", f"{where}: columns kept out: meta.seq"]


def test_other_runs_stand_in_other_tables(tmp_path: Path) -> None:
    """Commands of all runs, signals a run a file, and one run that has a table for itself."""
    head, *rows = ANGLES.splitlines(keepends=True)
    alone = {run: head + "".join(row for row in rows if row.startswith(run)) for run in "ab"}
    whole = "run,time,ctrl.motor,qpos.carriage,qvel.carriage\nc,0,1,0,0\nc,1,1,0,0\n"
    found = read(tmp_path, first=alone["a"], commands=COMMANDS, c=whole, second=alone["b"])
    assert sorted(found.runs) == ["a", "b", "c"]
    wanted = read(tmp_path, together=TOGETHER, c=whole)
    same(found.select(["a", "b", "c"]), wanted.select(["a", "b", "c"]))


def test_files_of_one_name_are_one_run(tmp_path: Path) -> None:
    for folder, text in (("sent", "time,ctrl.motor\n0,1\n1,2\n"), ("seen", "time,qpos.carriage\n0,0\n0.5,1\n")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "throw.csv").write_text(text)
    reader = TableReader([Signal("qpos.carriage", "m")], ["motor"])
    found = reader.read([tmp_path / "sent" / "throw.csv", tmp_path / "seen" / "throw.csv"])
    assert found.runs == ("throw",)
    assert found.data["time"][0].tolist() == [0.0, 0.5, 1.0]
    assert found.data["command"][0, :, 0].tolist() == [1.0, 1.0, 2.0]
    assert found.data["measured"][0, :, 0].tolist() == [True, True, False]


def test_what_was_measured_before_the_first_command_is_left_out(tmp_path: Path) -> None:
    notes: list[str] = []
    late = "run,time,ctrl.motor\na,0.1,1\na,0.2,1\nb,5,1\n"
    found = read(tmp_path, notes, commands=late, angles=ANGLES)
    assert found.data["time"][found.runs.index("a")].tolist()[:2] == pytest.approx([0.0, 0.1])
    assert any("before the first command are left out" in note for note in notes)


def test_columns_and_clocks_of_other_names_are_mapped(tmp_path: Path) -> None:
    (tmp_path / "one.csv").write_text("run,ms,u\na,0,1\na,50,2\n")
    (tmp_path / "two.csv").write_text("run,ms,angle\na,0,1\na,20,2\n")
    mapped, commanded = [SignalColumn(Signal("qpos.carriage"), "angle", 2.0)], [CommandColumn("motor", "u")]
    reader = TableReader([Signal("qpos.carriage")], ["motor"], mapped, commanded, TimeColumn("ms", 1e-3))
    found = reader.read([tmp_path / "one.csv", tmp_path / "two.csv"])
    assert found.data["time"][0].tolist() == [0.0, 0.02, 0.05]
    assert found.data["signal"][0, :, 0].tolist() == [2.0, 4.0, 0.0]


BAD = {
    "a column twice": (
        {"commands": COMMANDS, "angles": ANGLES.replace("meta.seq", "ctrl.motor")},
        r"angles\.csv, row 1, column 'ctrl\.motor': 'ctrl\.motor' of run 'a' also stands in .*commands\.csv",
    ),
    "a table twice": ({"commands": COMMANDS, "angles": ANGLES}, "run 'a' is given twice"),
    "time stands still": (
        {"commands": COMMANDS.replace("a,0.9", "a,0.25"), "angles": ANGLES},
        r"commands\.csv, row 4, column 'time': time goes from 0\.25 to 0\.25 s",
    ),
    "a run begins again": (
        {"commands": COMMANDS + "a,9,1\n", "angles": ANGLES},
        r"commands\.csv, row 6, column 'run': run 'a' begins again",
    ),
    "a written nan": (
        {"commands": COMMANDS.replace("a,0.25,2", "a,0.25,nan"), "angles": ANGLES},
        r"commands\.csv, row 3, column 'ctrl\.motor': a command cannot be nan",
    ),
    "other names of runs": (
        {"commands": COMMANDS.replace("a,", "A,").replace("b,", "B,"), "angles": ANGLES},
        r"commands\.csv, row 1: commands alone .* tables are joined where their column 'run' has the same names",
    ),
    "other names of runs, signals first": (
        {"angles": ANGLES.replace("a,", "A,").replace("b,", "B,"), "commands": COMMANDS},
        r"no column 'ctrl\.motor'.* a table that has it of the same 'run'",
    ),
    "a run without commands": (
        {"commands": COMMANDS.replace("b,5,-1\n", ""), "angles": ANGLES},
        r"angles\.csv, run 'b', row 1, column 'ctrl\.motor': no command yet",
    ),
    "no clock": (
        {"commands": COMMANDS.replace("time", "t"), "angles": ANGLES},
        r"commands\.csv, row 1: no column 'time'",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_joined_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    texts, message = BAD[case]
    for name, text in texts.items():
        (tmp_path / f"{name}.csv").write_text(text)
    paths = [tmp_path / f"{name}.csv" for name in texts]
    again = [paths[0]] if case == "a table twice" else []
    reader = TableReader([Signal("qpos.carriage", "m"), Signal("qvel.carriage", "m/s")], ["motor"])
    with pytest.raises(BadInput, match=message) as error:
        reader.read([*paths, *again])
    assert "\n" not in str(error.value)


def test_a_log_with_a_clock_of_its_own_is_not_joined(tmp_path: Path) -> None:
    rr = pytest.importorskip("rerun")
    stream = rr.RecordingStream("log")
    stream.save(str(tmp_path / "log.rrd"))
    stream.send_columns(
        "/angle", [rr.TimeColumn("time", duration=np.arange(3.0))], rr.Scalars.columns(scalars=np.ones(3))
    )
    stream.flush()
    stream.disconnect()
    (tmp_path / "log.csv").write_text("time,ctrl.motor\n0,1\n1,1\n")
    reader = TableReader([Signal("qpos.carriage")], ["motor"], [SignalColumn(Signal("qpos.carriage"), "/angle")])
    with pytest.raises(
        BadInput, match=r"log\.rrd: holds a run of .*log\.csv, but counts time from its own first sample"
    ):
        reader.read([tmp_path / "log.csv", tmp_path / "log.rrd"])
