"""The same log in every format is the same measurement, and what cannot be read is said in one line."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from onlinebayes.measurements import CommandColumn, Measurement, SignalColumn, TableReader
from onlinebayes.runs import BadInput
from tests.measurements.formats import logs


def from_csv(tmp_path: Path, **every: int) -> Measurement:
    path = tmp_path / "same.csv"
    path.write_text(logs.csv_table(**every))
    return TableReader(logs.SIGNALS, ["motor"]).read([path])


def assert_same(found: Measurement, wanted: Measurement, run: int = 0) -> None:
    assert found.signals == wanted.signals
    assert found.commands == wanted.commands
    for key in ("time", "command", "enable", "signal", "measured", "mask"):
        assert torch.equal(found.data[key][run], wanted.data[key][0]), key


@pytest.mark.parametrize("every", [{}, {"rate_every": 3, "command_every": 4}])
def test_mcap_in_json_reads_like_csv(tmp_path, every):
    logs.write_json_mcap(tmp_path / "log.mcap", **every)
    notes: list[str] = []
    found = logs.reader(*logs.MCAP, notes=notes).read([tmp_path / "log.mcap"])
    assert found.runs == ("log",)
    assert_same(found, from_csv(tmp_path, **every))
    assert "/joint_states.position[other]" in notes[0]


def test_mcap_in_protobuf_reads_like_csv(tmp_path):
    logs.write_protobuf_mcap(tmp_path / "log.mcap")
    assert_same(logs.reader(*logs.MCAP).read([tmp_path / "log.mcap"]), from_csv(tmp_path))


@pytest.mark.parametrize("version", ["v2.0", "v2.1", "v3.0", "2.1", "3.0"])
def test_a_lerobot_data_set_reads_like_csv(tmp_path, version):
    logs.write_lerobot(tmp_path / "pick", version)
    found = logs.reader(*logs.LEROBOT).read([tmp_path / "pick"])
    assert found.runs == ("pick-000000", "pick-000001")
    for run in range(2):
        assert_same(found, from_csv(tmp_path), run)


def test_a_rerun_recording_reads_like_csv(tmp_path):
    logs.write_rrd(tmp_path / "log.rrd")
    assert_same(logs.reader(*logs.RRD).read([tmp_path / "log.rrd"]), from_csv(tmp_path))


def test_a_rerun_recording_must_say_which_timeline_is_the_time(tmp_path):
    logs.write_rrd(tmp_path / "log.rrd", ("robot", "host"))
    with pytest.raises(BadInput, match="several timelines could be the time: host, robot; call the one"):
        logs.reader(*logs.RRD).read([tmp_path / "log.rrd"])
    logs.write_rrd(tmp_path / "own.rrd", ("robot",))
    assert_same(logs.reader(*logs.RRD).read([tmp_path / "own.rrd"]), from_csv(tmp_path))


def test_tables_of_several_formats_make_one_measurement(tmp_path):
    logs.write_json_mcap(tmp_path / "a.mcap")
    (tmp_path / "b.csv").write_text(logs.csv_table())
    mapped = [SignalColumn(signal, column) for signal, column in zip(logs.SIGNALS, logs.MCAP, strict=False)]
    with pytest.raises(BadInput, match=r"b\.csv.*no column that the model has"):
        TableReader(logs.SIGNALS, ["motor"], mapped, [CommandColumn("motor", logs.MCAP[2])]).read(
            [tmp_path / "a.mcap", tmp_path / "b.csv"]
        )
    logs.write_json_mcap(tmp_path / "c.mcap")
    found = logs.reader(*logs.MCAP).read([tmp_path / "a.mcap", tmp_path / "c.mcap"])
    assert found.runs == ("a", "c")


def test_a_log_may_begin_before_its_first_command(tmp_path):
    from mcap.writer import Writer

    with (tmp_path / "log.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        states, commands = (writer.register_channel(name, "json", 0) for name in ("/q", "/u"))
        for k in range(6):
            writer.add_message(states, 10**7 * k, b'{"q": %d, "v": 0}' % k, 10**7 * k)
        writer.add_message(commands, 25 * 10**6, b'{"u": 3}', 25 * 10**6)
        writer.finish()
    notes: list[str] = []
    found = logs.reader("/q.q", "/q.v", "/u.u", notes).read([tmp_path / "log.mcap"])
    assert torch.allclose(found.data["time"], torch.tensor([[0.0, 0.005, 0.015, 0.025]], dtype=torch.float64))
    assert found.data["measured"][0, :, 0].tolist() == [False, True, True, True]
    assert found.data["command"].flatten().tolist() == [3.0] * 4
    assert notes == [f"{tmp_path / 'log.mcap'}: the 0.025 s before the first command are left out"]


def test_a_command_may_be_mapped_with_sign_and_unit_in_csv_too(tmp_path):
    (tmp_path / "log.csv").write_text("time,u,qpos.hinge\n0,90,0\n1,,0\n2,45,0\n")
    command = CommandColumn("motor", "u", scale=-np.pi / 180, offset=1.0)
    found = TableReader(logs.SIGNALS, ["motor"], commanded=[command]).read([tmp_path / "log.csv"])
    wanted = 1 - np.pi / 180 * np.array([90.0, 90.0, 45.0])
    assert np.allclose(found.data["command"][0, :, 0], wanted)


@pytest.mark.parametrize(
    ("module", "write", "extra"),
    [("mcap", logs.write_json_mcap, "mcap"), ("pyarrow", logs.write_lerobot, "parquet")],
)
def test_a_missing_extra_says_what_to_install(tmp_path, monkeypatch, module, write, extra):
    write(tmp_path / "log")
    for name in [name for name in sys.modules if name.split(".")[0] == module]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(BadInput, match=rf"install the extra {extra} \(pip install -e '\.\[{extra}\]'"):
        logs.reader(*logs.MCAP).read([tmp_path / "log"])
