"""Clocks of logs as people have them, from ``init`` to a loaded problem."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from onlinebayes.cli.main import main
from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from tests.problems.conftest import table

EPOCH = 1_764_241_123


def rows() -> list[tuple[float, str, str]]:
    """Time, command and position of the first run."""
    cells = [row.split(",") for row in table().splitlines()[1:]]
    return [(float(t), u, q) for run, t, u, q in cells if run == "first"]


def write(path: Path, head: str, lines: list[str]) -> str:
    path.write_text("\n".join([head, *lines]) + "\n")
    return path.name


def make(folder: Path, capsys: pytest.CaptureFixture[str], *logs: str) -> tuple[int, str]:
    paths = [str(folder / log) for log in logs]
    status = main(["init", str(folder / "carriage.xml"), *paths, "--out", str(folder / "first.toml")])
    return status, "".join(capsys.readouterr())


def clock(folder: Path) -> object:
    return tomllib.loads((folder / "first.toml").read_text()).get("time")


def loaded(folder: Path) -> list[float]:
    return load_problem(folder / "first.toml").measurement.data["time"][0, :4].tolist()


@pytest.mark.parametrize("prefix", ["", "header.stamp.", "field.header.stamp."])
def test_seconds_and_nanoseconds_are_one_clock(folder, capsys, prefix: str) -> None:
    lines = [f"{EPOCH + int(t)},{round(t % 1 * 1e9)},{u},{q}" for t, u, q in rows()]
    head = f"{prefix}sec,{prefix}nanosec,ctrl.motor,qpos.carriage"
    status, said = make(folder, capsys, write(folder / "lab.csv", head, lines))
    assert status == 0
    assert f"time <- {prefix}sec + {prefix}nanosec [s]" in said
    assert clock(folder) == {"column": f"{prefix}sec", "unit": "s", "rest": f"{prefix}nanosec"}
    assert loaded(folder) == [0.0, 0.01, 0.02, 0.03]


@pytest.mark.parametrize(
    ("column", "ticks", "start", "unit"),
    [
        ("tick_ms", 1e3, 1_764_000_000_000, "ms"),
        ("robot_time", 1e6, EPOCH * 10**6, "us"),
        ("Zeit_ms", 1e3, 0, "ms"),
    ],
)
def test_the_only_column_that_rises_and_speaks_of_time_is_a_guess(
    folder, capsys, column: str, ticks: float, start: int, unit: str
) -> None:
    lines = [f"{start + round(t * ticks)},{k % 256},{u},{q}" for k, (t, u, q) in enumerate(rows())]
    _, said = make(folder, capsys, write(folder / "lab.csv", f"{column},seq,ctrl.motor,qpos.carriage", lines))
    assert f"time <- {column} [{unit}]   (a guess, it alone rises in every row: check it)" in said
    assert clock(folder) == {"column": column, "unit": unit}
    assert loaded(folder) == [0.0, 0.01, 0.02, 0.03]


def test_a_counter_that_wraps_is_a_clock_too(folder, capsys) -> None:
    lines = [f"{(2**32 - 25_000 + round(t * 1e6)) % 2**32},{u},{q}" for t, u, q in rows()]
    status, said = make(folder, capsys, write(folder / "lab.csv", "mcu_us,ctrl.motor,qpos.carriage", lines))
    assert status == 0
    assert "time <- mcu_us [us]" in said
    assert loaded(folder) == pytest.approx([0.0, 0.01, 0.02, 0.03])


def test_topics_of_one_clock_beside_a_log_of_another(folder, capsys) -> None:
    seen = write(folder / "states.csv", "time,carriage_pos", [f"{t},{q}" for t, _, q in rows()])
    more = write(folder / "power.csv", "time,battery", [f"{t},12" for t, _, _ in rows()])
    sent = write(folder / "planner.csv", "stamp,motor_cmd", [f"{EPOCH + t:.3f},{u}" for t, u, _ in rows()])
    status, said = make(folder, capsys, seen, more, sent)
    assert status == 0
    assert f"do not overlap: 'time' goes from 0 to {rows()[-1][0]:g} s in {folder / 'states.csv'}" in said
    assert "qpos.carriage <- carriage_pos" in said
    assert "ctrl.motor <- motor_cmd" in said


def test_two_that_rise_are_a_question(folder, capsys) -> None:
    lines = [f"{t},{t + 0.001},{u},{q}" for t, u, q in rows()]
    _, said = make(folder, capsys, write(folder / "lab.csv", "robot_time,host_time,ctrl.motor,qpos.carriage", lines))
    assert "missing:   time: robot_time or host_time could be it" in said


def test_one_table_a_topic_each_with_its_clock_is_one_run(folder, capsys) -> None:
    seen = write(folder / "states.csv", "time,carriage_pos", [f"{t},{q}" for t, _, q in rows()])
    sent = write(folder / "orders.csv", "stamp_ms,motor_cmd", [f"{1000 * t:.0f},{u}" for t, u, _ in rows()])
    status, said = make(folder, capsys, seen, sent)
    assert status == 0
    assert "missing" not in said
    assert "qpos.carriage <- carriage_pos" in said
    assert clock(folder) == {"orders.csv": {"column": "stamp_ms", "unit": "ms"}}
    assert load_problem(folder / "first.toml").measurement.runs == ("states+orders",)


def test_clocks_that_do_not_overlap_are_said_and_the_columns_matched(folder, capsys) -> None:
    seen = write(folder / "robot.csv", "timestamp,carriage_pos", [f"{t + 37.5},{q}" for t, _, q in rows()])
    sent = write(folder / "planner.csv", "stamp,motor_cmd", [f"{EPOCH + t:.3f},{u}" for t, u, _ in rows()])
    status, said = make(folder, capsys, seen, sent)
    assert status == 0
    assert "clocks of run 'robot+planner' do not overlap: 'timestamp' goes from 37.5 to" in said
    assert f'[time."planner.csv"] offset_s = {37.5 - EPOCH:.6f}' in said
    assert "ctrl.motor <- motor_cmd" in said
    with pytest.raises(BadInput, match="do not overlap"):
        load_problem(folder / "first.toml")
    text = (folder / "first.toml").read_text()
    assert "# CLOCKS: " in text
    tied = text.replace('column = "stamp"', f'column = "stamp"\noffset_s = {37.5 - EPOCH:.6f}')
    (folder / "first.toml").write_text(tied)
    (seconds,) = load_problem(folder / "first.toml").measurement.durations
    assert seconds == pytest.approx(rows()[-1][0], abs=1e-6)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('[time."other.csv"]\ncolumn = "t"', r'time\."other\.csv": no table is called so; name one of carriage\.csv'),
        ("[time]\noffset = 3", r"time\.offset: unknown key; nearest: offset_s"),
        ('[time."*.csv"]\nunit = "m"', r"unit 'm' cannot become s"),
        ('[time]\nrest = "nanosec"', r"no column 'nanosec'"),
    ],
)
def test_what_is_wrong_in_a_clock_is_one_line(folder, lines: str, message: str) -> None:
    with (folder / "carriage.toml").open("a") as file:
        file.write(f"\n{lines}\n")
    with pytest.raises(BadInput, match=message):
        load_problem(folder / "carriage.toml")
