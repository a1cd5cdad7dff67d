"""Clocks as logs have them: two columns, counters that wrap, epochs, clocks of several tables."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from onlinebayes.measurements import Measurement, Signal, TableReader, TimeColumn
from onlinebayes.measurements.mapping import SECONDS
from onlinebayes.runs import BadInput

EPOCH = 1_764_241_123
STEP = np.arange(6) * 0.01


def read(
    folder: Path,
    clock: TimeColumn = SECONDS,
    clocks: Mapping[str, TimeColumn] | None = None,
    notes: list[str] | None = None,
    **tables: str,
) -> Measurement:
    for name, text in tables.items():
        (folder / f"{name}.csv").write_text(text)
    reader = TableReader(
        [Signal("qpos.hinge")],
        ["motor"],
        clock=clock,
        note=(lambda _line: None) if notes is None else notes.append,
        clocks={folder / f"{name}.csv": one for name, one in (clocks or {}).items()},
    )
    return reader.read([folder / f"{name}.csv" for name in tables])


def table(*clock: object, head: str = "time") -> str:
    rows = [f"{head},ctrl.motor,qpos.hinge", *(f"{t},1,{k / 10}" for k, t in enumerate(clock))]
    return "\n".join(rows) + "\n"


def part(column: str, clock: list[object], head: str = "time") -> str:
    return "\n".join([f"{head},{column}", *(f"{t},{k / 10}" for k, t in enumerate(clock))]) + "\n"


def times(measurement: Measurement) -> list[float]:
    return measurement.data["time"][0].tolist()


def test_seconds_and_nanoseconds_in_two_columns_are_exact(tmp_path: Path) -> None:
    cells = [f"{EPOCH + (k >= 4)},{k * 333_333_333 % 10**9}" for k in range(6)]
    found = read(tmp_path, TimeColumn("sec", rest="nanosec"), log=table(*cells, head="sec,nanosec"))
    assert times(found) == [0.0, 0.333333333, 0.666666666, 0.999999999, 1.333333332, 1.666666665]


def test_an_epoch_in_nanoseconds_keeps_each_of_them(tmp_path: Path) -> None:
    """As float64 it would count in steps of 256 ns."""
    cells = [EPOCH * 10**9 + 100 * k for k in range(6)]
    found = read(tmp_path, TimeColumn("t", 1e-9), log=table(*cells, head="t"))
    assert times(found) == [0.0, 1e-7, 2e-7, 3e-7, 4e-7, 5e-7]


def test_parquet_keeps_them_too(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    cells = EPOCH * 10**9 + 100 * np.arange(6)
    pq.write_table(pa.table({"t": cells, "ctrl.motor": np.ones(6), "qpos.hinge": np.ones(6)}), tmp_path / "log.parquet")
    reader = TableReader([Signal("qpos.hinge")], ["motor"], clock=TimeColumn("t", 1e-9))
    assert times(reader.read([tmp_path / "log.parquet"])) == [0.0, 1e-7, 2e-7, 3e-7, 4e-7, 5e-7]


def test_tables_with_an_epoch_in_nanoseconds_are_joined_row_by_row(tmp_path: Path) -> None:
    clock = [EPOCH * 10**9 + 100 * k for k in range(6)]
    head = TimeColumn("t", 1e-9)
    found = read(tmp_path, head, seen=part("qpos.hinge", clock, "t"), sent=part("ctrl.motor", clock, "t"))
    assert times(found) == [0.0, 1e-7, 2e-7, 3e-7, 4e-7, 5e-7]
    assert bool(found.data["measured"].all())


def test_time_begins_at_zero_in_the_first_run_and_the_others_keep_their_distance(tmp_path: Path) -> None:
    rows = "run,time,ctrl.motor,qpos.hinge\na,37.5,1,0\na,38,1,0\nb,99.25,1,0\nb,99.5,1,0\n"
    assert read(tmp_path, log=rows).data["time"].tolist() == [[0.0, 0.5], [61.75, 62.0]]


@pytest.mark.parametrize(
    ("cells", "unit"),
    [
        ([(2**32 - 25_000 + 10_000 * k) % 2**32 for k in range(6)], 1e-6),
        ([(2**16 - 25 + 10 * k) % 2**16 for k in range(6)], 1e-3),
        ([(2**31 - 25 + 10 * k + 2**31) % 2**32 - 2**31 for k in range(6)], 1e-3),
        ([f"{(2**32 - 25_000 + 10_000 * k) % 2**32 / 1e6:.6f}" for k in range(6)], 1.0),
    ],
    ids=["32 bits of us", "16 bits of ms", "31 bits and a sign", "us written in s"],
)
def test_a_counter_that_wraps_is_put_straight_and_said(tmp_path: Path, cells: list[object], unit: float) -> None:
    notes: list[str] = []
    found = read(tmp_path, TimeColumn("tick", unit), notes=notes, log=table(*cells, head="tick"))
    assert times(found) == pytest.approx(STEP, abs=1e-9)
    assert len(notes) == 1
    assert "'tick' begins again at" in notes[0]


@pytest.mark.parametrize("cells", [(0, 1, 2, 0, 1, 2), (65_500, 65_510, 3, 13), (100.0, 100.1, 100.2, 4.0)])
def test_time_that_begins_again_otherwise_is_refused(tmp_path: Path, cells: tuple[float, ...]) -> None:
    refused = cells[1] != 65_510  # a counter of 16 bits
    if refused:
        with pytest.raises(BadInput, match="it must increase strictly within a run"):
            read(tmp_path, log=table(*cells))
    else:
        assert times(read(tmp_path, log=table(*cells))) == [0.0, 10.0, 39.0, 49.0]


def test_an_epoch_in_float32_is_said_with_its_resolution(tmp_path: Path) -> None:
    cells = [f"{float(np.float32(EPOCH + 30 * k)):.1f}" for k in range(12)]
    with pytest.raises(BadInput, match=r"row 3, column 'time': .* a float32 near 1764241\d+ has steps of 128 s"):
        read(tmp_path, log=table(*cells))


def test_whole_seconds_alone_name_the_column_of_the_rest(tmp_path: Path) -> None:
    cells = [f"{EPOCH},{k * 10**7}" for k in range(6)]
    with pytest.raises(BadInput, match=r'\[time\] column = "stamp_sec", rest = "stamp_nanosec"'):
        read(tmp_path, TimeColumn("stamp_sec"), log=table(*cells, head="stamp_sec,stamp_nanosec"))


def test_every_table_may_have_a_clock_of_its_own(tmp_path: Path) -> None:
    seen, sent = part("qpos.hinge", [*STEP], "t"), part("ctrl.motor", [*(STEP * 1e3)], "ms")
    found = read(tmp_path, TimeColumn("t"), {"sent": TimeColumn("ms", 1e-3)}, seen=seen, sent=sent)
    assert times(found) == pytest.approx(STEP)
    assert found.data["command"][0, :, 0].tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5])


def test_one_table_a_topic_is_one_run_where_the_clocks_overlap(tmp_path: Path) -> None:
    notes: list[str] = []
    seen, sent = part("qpos.hinge", [*STEP]), part("ctrl.motor", [*(STEP + 0.005)])
    found = read(tmp_path, notes=notes, swing_seen=seen, swing_sent=sent)
    assert found.runs == ("swing",)
    assert any("as topics of one recording, run 'swing'" in note for note in notes)
    assert read(tmp_path, states=seen, orders=sent).runs == ("states+orders",)


def test_topics_of_several_recordings_are_told_apart_by_their_clocks(tmp_path: Path) -> None:
    late = STEP + 60
    tables = {
        "a_seen": part("qpos.hinge", [*STEP]),
        "a_sent": part("ctrl.motor", [*STEP]),
        "b_seen": part("qpos.hinge", [*late]),
        "b_sent": part("ctrl.motor", [*late]),
    }
    found = read(tmp_path, **tables)
    assert found.runs == ("a", "b")
    assert bool(found.data["measured"].all())
    tables["b_seen"], tables["b_sent"] = tables["a_seen"], tables["a_sent"]  # which belongs to which?
    with pytest.raises(BadInput, match=r"'ctrl\.motor'.* a table that has it of the same 'run'"):
        read(tmp_path, **tables)


@pytest.mark.parametrize("names", [("ctl/log", "plan/log"), ("ctl", "plan")])
def test_clocks_that_do_not_overlap_are_said_with_what_to_write(tmp_path: Path, names: tuple[str, str]) -> None:
    for folder in ("ctl", "plan"):
        (tmp_path / folder).mkdir()
    seen, sent = names
    clock = [*(STEP + 37.25)]
    tables = {seen: part("qpos.hinge", clock), sent: part("ctrl.motor", [EPOCH + k / 100 for k in range(6)])}
    with pytest.raises(BadInput, match="do not overlap") as error:
        read(tmp_path, **tables)
    line = str(error.value)
    assert "from 37.25 to 37.3 s" in line
    assert f"from {EPOCH} to {EPOCH}.05 s" in line
    key = f"{sent}.csv"
    assert f'[time."{key}"] offset_s = {37.25 - EPOCH:.6f}' in line
    tied = read(tmp_path, SECONDS, {sent: TimeColumn(offset=37.25 - EPOCH)}, **tables)
    assert times(tied)[-1] == pytest.approx(0.05, abs=1e-6)
    assert len(tied.runs) == 1


def test_a_command_sent_before_the_log_began_is_held(tmp_path: Path) -> None:
    """Ranges that do not overlap, but are near: one order, and then the motion."""
    tables = {"seen": part("qpos.hinge", [1.0, 2.0, 3.0]), "sent": part("ctrl.motor", [0.0])}
    for name, text in tables.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "log.csv").write_text(text)
    reader = TableReader([Signal("qpos.hinge")], ["motor"])
    found = reader.read([tmp_path / "seen" / "log.csv", tmp_path / "sent" / "log.csv"])
    assert found.data["command"][0, :, 0].tolist() == [0.0] * 4
