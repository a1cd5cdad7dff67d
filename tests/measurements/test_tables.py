"""What a table may look like, and the line that says what is wrong with it: file, row, column, cure."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from onlinebayes.measurements import CommandColumn, Measurement, Signal, SignalColumn, TableReader, TimeColumn
from onlinebayes.runs import BadInput

HEAD = "run,time,ctrl.motor,qpos.carriage\n"
GOOD = HEAD + "a,0,1,0\na,0.1,,0.5\na,0.2,2,\nb,3,-1,nan\nb,3.5,0,1e-3\n"


def reader(notes: list[str] | None = None, **changes) -> TableReader:
    given = {
        "signals": [Signal("qpos.carriage", "m"), Signal("qvel.carriage", "m/s")],
        "commands": ["motor"],
        "note": (lambda _line: None) if notes is None else notes.append,
    }
    return TableReader(**{**given, **changes})


def read(tmp_path: Path, text: str | bytes, notes: list[str] | None = None, **changes) -> Measurement:
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return reader(notes, **changes).read([path])


def test_a_table_becomes_a_measurement(tmp_path):
    m = read(tmp_path, GOOD)
    assert m.runs == ("a", "b")
    assert m.signals == (Signal("qpos.carriage", "m"),)
    assert m.lengths.tolist() == [3, 2]
    assert m.data["command"][0, :, 0].tolist() == [1.0, 1.0, 2.0]
    assert m.data["signal"][0, :, 0].tolist() == [0.0, 0.5, 0.0]
    assert m.data["measured"][0, :, 0].tolist() == [True, True, False]
    assert m.data["measured"][1, :2, 0].tolist() == [False, True]


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + GOOD,
        GOOD.replace("\n", "\r\n"),
        GOOD.rstrip("\n"),
        GOOD + "\n\n",
        GOOD.replace("a,0.1", "\na,0.1"),
        GOOD.replace(",", " , "),
        GOOD.replace("a,", '"a",').replace("ctrl.motor", '"ctrl.motor"'),
        GOOD.replace("nan", "NaN").replace("1e-3", "+1.0E-03"),
    ],
)
def test_the_same_table_written_otherwise(tmp_path, text):
    assert bool((read(tmp_path, text).data == read(tmp_path, GOOD).data).all())


def test_without_a_run_column_the_file_is_one_run(tmp_path):
    assert read(tmp_path, "time,ctrl.motor,qpos.carriage\n0,1,0\n1,1,0\n").runs == ("log",)


def test_signals_stand_in_the_models_order_whatever_the_tables(tmp_path):
    m = read(tmp_path, "qvel.carriage,time,qpos.carriage,ctrl.motor\n1,0,2,3\n1,1,2,3\n")
    assert [s.name for s in m.signals] == ["qpos.carriage", "qvel.carriage"]
    assert m.data["signal"][0, 0].tolist() == [2.0, 1.0]
    assert m.data["command"][0, 0].tolist() == [3.0]


def test_two_tables_may_measure_different_signals(tmp_path):
    (tmp_path / "one.csv").write_text("time,ctrl.motor,qpos.carriage\n0,1,0\n1,1,0\n")
    (tmp_path / "two.csv").write_text("time,ctrl.motor,qvel.carriage\n0,1,5\n1,1,5\n2,1,5\n")
    m = reader().read([tmp_path / "one.csv", tmp_path / "two.csv"])
    assert m.runs == ("one", "two")
    assert m.data["measured"].any(1).tolist() == [[True, False], [False, True]]
    with pytest.raises(BadInput, match="run 'one' is given twice"):
        reader().read([tmp_path / "one.csv", tmp_path / "one.csv"])


def test_what_the_model_lacks_is_named_once_and_kept_out(tmp_path):
    notes: list[str] = []
    text = GOOD.replace("\n", ",x\n").replace("carriage,x", "carriage,meta.pulse")
    text = text.replace("\n", ",0\n").replace("pulse,0", "pulse,sensor.reference")
    read(tmp_path, text, notes)
    assert len(notes) == 1
    assert "meta.pulse, sensor.reference" in notes[0]


def test_known_quantities_that_are_not_compared_are_named_as_such(tmp_path):
    notes: list[str] = []
    text = "time,ctrl.motor,qpos.carriage,qfrc.carriage,sensor.load\n0,1,0,0,0\n1,1,0,0,0\n"
    read(tmp_path, text, notes, known=["sensor.load"])
    assert notes == [f"{tmp_path / 'log.csv'}: columns not compared by this version: qfrc.carriage, sensor.load"]


def test_a_column_may_be_mapped_to_a_signal(tmp_path):
    mapped = [SignalColumn(Signal("qpos.carriage", "m", sd=1e-4), column="position", scale=-1e-3, offset=0.5)]
    m = read(tmp_path, "time,ctrl.motor,position\n0,1,100\n1,1,\n", mapped=mapped)
    assert m.signals == (Signal("qpos.carriage", "m", sd=1e-4),)
    assert m.data["signal"][0, 0, 0].item() == pytest.approx(0.4)
    assert m.data["measured"][0, :, 0].tolist() == [True, False]


@pytest.mark.parametrize(
    ("text", "changes", "message"),
    [
        (
            GOOD.replace("qpos.carriage", "qvel.carriage"),
            {},
            r"log\.csv, row 1: no column 'position', which \[signals\.\"qpos\.carriage\"\] names; "
            r"the columns are 'ctrl\.motor', 'qvel\.carriage'$",
        ),
        (
            GOOD.replace("qpos.carriage", "Position"),
            {},
            r"no column 'position', which .* names; nearest: Position; ",
        ),
        (
            "time,ctrl.motor,qvel.carriage,position\n0,1,0,0\n1,1,0,0\n",
            {"ignore": ["pos*"]},
            "no column 'position'.*it is there, but 'ignore' leaves it out",
        ),
        (
            "time," + ",".join(f"c{k}" for k in range(15)) + "\n" + ",".join("0" * 16) + "\n",
            {},
            r"no column 'position', which .* names; the columns are 'c0', .*, 'c11' and 3 more$",
        ),
    ],
)
def test_the_columns_that_are_there_are_named_where_one_is_missed(tmp_path, text, changes, message):
    mapped = [SignalColumn(Signal("qpos.carriage", "m"), column="position")]
    with pytest.raises(BadInput, match=message):
        read(tmp_path, text, mapped=mapped, **changes)


def test_a_mapped_column_that_no_table_has_names_the_tables(tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.csv").write_text(GOOD.replace("a,", f"{name}a,").replace("b,", f"{name}b,"))
    mapped = [SignalColumn(Signal("qvel.carriage", "m/s"), column="speed")]
    with pytest.raises(BadInput, match=r"one\.csv, .*two\.csv, row 1: no column 'speed'"):
        reader(mapped=mapped).read([tmp_path / "one.csv", tmp_path / "two.csv"])


def test_an_actuator_that_is_off_needs_no_command(tmp_path):
    m = read(tmp_path, "time,enable.motor,qpos.carriage\n0,0,0\n1,,0\n")
    assert m.data["enable"].flatten().tolist() == [0.0, 0.0]
    m = read(tmp_path, "time,ctrl.motor,enable.motor,qpos.carriage\n0,1,True,0\n1,2,False,0\n")
    assert m.data["enable"].flatten().tolist() == [1.0, 0.0]
    m = read(tmp_path, "time,ctrl.motor,enable.motor,qpos.carriage\n0,,0,0\n1,,,0\n2,5,1,0\n")
    assert m.data["command"].flatten().tolist() == [0.0, 0.0, 5.0]
    assert m.data["enable"].flatten().tolist() == [0.0, 0.0, 1.0]


def test_a_switch_may_have_a_name_of_its_own(tmp_path):
    text = "time,ctrl.motor,ctrl.torque_enable,qpos.carriage\n0,1,1,0\n1,1,0,0\n"
    m = read(tmp_path, text, commanded=[CommandColumn("motor", enable="ctrl.torque_enable")])
    assert m.commands == ("motor",)
    assert m.data["enable"].flatten().tolist() == [1.0, 0.0]
    with pytest.raises(
        BadInput, match=r"no column 'ctrl\.enabled', which switches .*'motor'; nearest: ctrl.torque_enable; the columns"
    ):
        read(tmp_path, text, commanded=[CommandColumn("motor", enable="ctrl.enabled")])


def test_a_command_may_be_the_product_of_two_columns(tmp_path):
    volts = CommandColumn("motor", "sensor.duty", scale=-0.01, offset=0.5, times="sensor.supply")
    text = "time,sensor.duty,sensor.supply,qpos.carriage\n0,50,7,0\n1,100,,0\n2,,6,0\n"
    m = read(tmp_path, text, commanded=[volts])
    assert m.data["command"].flatten().tolist() == pytest.approx([-3.0, -6.5, -5.5])  # either holds its last value
    with pytest.raises(BadInput, match=r"no column 'sensor\.supply', which multiplies the command of .*'motor'"):
        read(tmp_path, text.replace("sensor.supply", "sensor.volts"), commanded=[volts])
    with pytest.raises(BadInput, match="no command yet"):
        read(tmp_path, text.replace("50,7", "50,"), commanded=[volts])


COMMANDS_ALONE = (
    "row 1: commands alone cannot stand by themselves; tables are joined where their column 'run' has the same names: "
    "name the runs alike there, or write one table; give one of 'qpos.carriage', 'qvel.carriage'$"
)
BAD = {
    "goes back": (GOOD.replace("a,0.2", "a,0.05"), r"row 4, column 'time': time goes from 0\.1 to 0\.05 s"),
    "stands still": (GOOD.replace("a,0.2", "a,0.1"), "row 4, column 'time': time goes from"),
    "inf": (GOOD.replace("0.5", "inf"), "row 3, column 'qpos.carriage': inf"),
    "infinite time": (GOOD.replace("a,0.2", "a,inf"), "row 4, column 'time': inf"),
    "no time": (GOOD.replace("a,0.2", "a,"), "row 4, column 'time': the time cannot be nan"),
    "nan command": (GOOD.replace("a,0.2,2", "a,0.2,nan"), "row 4, column 'ctrl.motor': a command cannot be nan"),
    "infinite command": (GOOD.replace("a,0.2,2", "a,0.2,-inf"), "row 4, column 'ctrl.motor': -inf"),
    "no first command": (GOOD.replace("b,3,-1", "b,3,"), "row 5, column 'ctrl.motor': no command yet"),
    "text": (GOOD.replace("0.5", "half"), "row 3, column 'qpos.carriage': 'half' is not a number"),
    "decimal comma": (GOOD.replace("0.5", '"0,5"'), "row 3, column 'qpos.carriage': '0,5' .* decimal point"),
    "semicolons": (GOOD.replace(",", ";"), "row 1: the columns are separated by semicolons"),
    "tabs": (GOOD.replace(",", "\t"), "row 1: the columns are separated by tabs"),
    "ragged": (GOOD.replace("a,0.1,,0.5", "a,0.1,0.5"), "row 3: 3 cells where the header has 4"),
    "one row": (HEAD + "a,0,1,0\n", "row 2: a run of 1 row; give two or more"),
    "short run": (GOOD + "c,0,0,0\n", "row 7: a run of 1 row; give two or more"),
    "header only": (HEAD, "a header and no rows"),
    "empty": ("", "the file is empty"),
    "blank": ("\n\n", "the first row is empty"),
    "no run": (GOOD.replace("b,3,", ",3,"), "row 5, column 'run': a row without a run"),
    "run again": (GOOD + "a,9,0,0\na,10,0,0\n", r"row 7, column 'run': run 'a' begins again \(it ended at row 4\)"),
    "twice": (GOOD.replace("qpos.carriage", "ctrl.motor"), "row 1: two columns are called 'ctrl.motor'"),
    "no time column": (GOOD.replace("time", "Time"), "row 1: no column 'time'; nearest: Time"),
    "joint": (GOOD.replace("qpos.carriage", "qpos.carrige"), "column 'qpos.carrige': .*nearest: qpos.carriage"),
    "actuator": (GOOD.replace("ctrl.motor", "ctrl.moto"), "column 'ctrl.moto': .*no actuator 'moto'; nearest: motor"),
    "no command": (
        "time,qpos.carriage,u\n0,0,0\n1,0,0\n",
        "row 1: no column 'ctrl.motor', the command .* or map one of its columns: 'qpos.carriage', 'u'$",
    ),
    "no signal": ("time,ctrl.motor\n0,0\n1,0\n", COMMANDS_ALONE),
    "nothing of the model": ("time,u\n0,0\n1,0\n", "row 1: no column that the model has; .*, or map .*: 'u'$"),
    "latin": (GOOD.encode().replace(b"0.5", b"\xe9"), "row 3, byte 0xe9: the file is not UTF-8"),
    "utf-16": (GOOD.encode("utf-16"), "the file is UTF-16"),
    "binary": (bytes(range(256)) * 8, "not UTF-8"),
    "zeros": (bytes(4096), "not a text file"),
    "quote": (GOOD.replace("a,0.1,", 'a,"0.1,'), "line 6: is no readable CSV"),
    "enable": ("time,enable.motor,qpos.carriage\n0,0,0\n1,2,0\n", "row 3, column 'enable.motor': enable is 2"),
    "on": ("time,enable.motor,qpos.carriage\n0,0,0\n1,1,0\n", "no column 'ctrl.motor'"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_is_said_in_one_line(tmp_path, name):
    text, message = BAD[name]
    with pytest.raises(BadInput, match=message) as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)
    assert "log.csv" in str(caught.value)
    assert ";" in str(caught.value), "no cure"


@pytest.mark.parametrize(
    ("names", "cure"),
    [
        ("aabb", r"'test' seems to name the runs: call that column 'run'$"),
        ("aaaa", "sort the rows, or, where a column names the runs, call that column 'run'$"),
        ("aaab", "sort the rows, or, where a column names the runs, call that column 'run'$"),
    ],
)
def test_runs_under_another_name_are_told_and_the_clock_has_its_own(tmp_path, names, cure):
    rows = [f"{test},{t},0,0" for test, t in zip(names, (0, 8, 0, 8), strict=True)]
    text = "\n".join(["test,t_ms,ctrl.motor,qpos.carriage", *rows]) + "\n"
    wanted = rf"row 4, column 't_ms': time goes from 0\.008 to 0 s; it must increase strictly within a run: {cure}"
    with pytest.raises(BadInput, match=wanted):
        read(tmp_path, text, clock=TimeColumn("t_ms", 1e-3))


def test_a_column_that_the_problem_ignores_is_no_error(tmp_path):
    wider = GOOD.replace("run,", "run,qpos.elbow,").replace("a,", "a,9,").replace("b,", "b,9,")
    m, without = read(tmp_path, wider, ignore=["qpos.el*"]), read(tmp_path, GOOD)
    assert m.signals == without.signals
    assert m.runs == without.runs
    assert bool((m.data == without.data).all())


def test_a_missing_file_and_a_folder(tmp_path):
    with pytest.raises(BadInput, match=r"none\.csv: no such file"):
        reader().read([tmp_path / "none.csv"])
    with pytest.raises(BadInput, match=r"is a folder without meta/info\.json"):
        reader().read([tmp_path])


def test_row_numbers_stay_right_past_the_first_piece(tmp_path, monkeypatch):
    monkeypatch.setattr("onlinebayes.measurements.formats.delimited.CHUNK", 3)
    rows = [f"a,{k},0,0\n" for k in range(20)]
    rows[15] = "a,15,0,x\n"
    with pytest.raises(BadInput, match=r"row 17, column 'qpos\.carriage'"):
        read(tmp_path, HEAD + "".join(rows))
    rows[15] = "a,15,0\n"
    with pytest.raises(BadInput, match="row 17: 3 cells"):
        read(tmp_path, HEAD + "".join(rows))


def test_parquet_reads_like_csv(tmp_path):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = {
        "run": pa.array(["a", "a", "a", "b", "b"]),
        "time": [0.0, 0.1, 0.2, 3.0, 3.5],
        "ctrl.motor": pa.array([1, None, 2, -1, 0]),
        "qpos.carriage": [0.0, 0.5, None, math.nan, 1e-3],
    }
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    m = reader().read([tmp_path / "log.parquet"])
    assert bool((m.data == read(tmp_path, GOOD).data).all())
    for change, message in (
        ({"ctrl.motor": [1.0, 1.0, math.nan, 0.0, 0.0]}, "row 4, column 'ctrl.motor': a command cannot be nan"),
        ({"time": [0.0, 0.1, 0.05, 3.0, 3.5]}, "row 4, column 'time': time goes"),
        ({"time": pa.array(["0", "1", "2", "3", "4"])}, "column 'time': the column holds string, not numbers"),
    ):
        pq.write_table(pa.table({**columns, **change}), tmp_path / "log.parquet")
        with pytest.raises(BadInput, match=message):
            reader().read([tmp_path / "log.parquet"])
    (tmp_path / "log.parquet").write_bytes(b"PAR1 and then nothing of use")
    with pytest.raises(BadInput, match="damaged"):
        reader().read([tmp_path / "log.parquet"])
    (tmp_path / "log.parquet").write_text(GOOD)
    with pytest.raises(BadInput, match="not a Parquet file"):
        reader().read([tmp_path / "log.parquet"])


def test_emps_loads_whole(data):
    m = reader().read([data / "emps" / "emps.csv"])
    assert m.runs == ("plain", "pulses")
    assert m.lengths.tolist() == [24841, 24841]
    assert bool(m.data["measured"].all())
    step = m.data["time"].diff(dim=1)
    assert torch.allclose(step, torch.full_like(step, 1e-3), atol=1e-6)


def test_a_big_table_is_read_in_pieces(tmp_path):
    rows = 250_000
    grid = np.arange(rows) * 1e-3
    lines = [f"a,{t:.3f},0,{q}" for t, q in zip(grid, np.round(np.sin(grid), 6), strict=True)]
    m = read(tmp_path, HEAD + "\n".join(lines))
    assert m.lengths.tolist() == [rows]
    assert float((m.data["signal"][0, :, 0] - torch.sin(m.data["time"][0])).abs().max()) < 1e-6


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_truth_values_as_commands_are_said(tmp_path, suffix):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    text = "time,ctrl.motor,enable.motor,qpos.carriage\n0,True,True,0\n1,False,True,0\n"
    (tmp_path / "log.csv").write_text(text)
    told, enabled = [True, False], [True, True]
    columns = {"time": [0.0, 1.0], "ctrl.motor": told, "enable.motor": enabled, "qpos.carriage": [0.0, 0.0]}
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    notes: list[str] = []
    found = reader(notes).read([tmp_path / f"log.{suffix}"])
    assert found.data["command"][0, :, 0].tolist() == [1.0, 0.0]
    path = tmp_path / f"log.{suffix}"
    assert notes == [f"{path}: 'ctrl.motor' is written as True and False: read as commands of 1 and 0"]


@pytest.mark.parametrize(("told", "seen", "said"), [("0", "1", True), ("0", "0", False), ("1", "1", False)])
def test_commands_of_zeros_beside_a_motion_are_said(tmp_path, told, seen, said):
    notes: list[str] = []
    (tmp_path / "log.csv").write_text(f"time,ctrl.motor,qpos.carriage\n0,0,0\n1,{told},{seen}\n")
    reader(notes).read([tmp_path / "log.csv"])
    line = "every command is 0 in every row, while qpos.carriage moves: are they in other columns?"
    assert notes == [line] * said
