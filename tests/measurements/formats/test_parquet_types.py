"""Columns of Parquet that are numbers though no float says so: nothing but nulls, decimals."""

from __future__ import annotations

from decimal import Decimal

import numpy as np
import pytest

from onlinebayes.measurements import Signal, TableReader
from onlinebayes.measurements.formats.lerobot import lerobot_source
from tests.measurements.formats import logs

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")


def test_nulls_alone_were_not_measured_and_decimals_are_numbers(tmp_path):
    columns = {
        "time": pa.array([Decimal("0.00"), Decimal("0.01"), Decimal("0.02")], pa.decimal128(6, 2)),
        "qpos.hinge": pa.array([Decimal("1.25"), None, Decimal("-1.50")], pa.decimal128(6, 2)),
        "qvel.hinge": pa.nulls(3),
        "ctrl.motor": [0, 1, None],
    }
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    signals = [Signal("qpos.hinge", "rad"), Signal("qvel.hinge", "rad/s")]
    data = TableReader(signals, ["motor"]).read([tmp_path / "log.parquet"]).data[0]
    assert data["time"].tolist() == [0.0, 0.01, 0.02]
    assert data["measured"].tolist() == [[True, False], [False, False], [True, False]]
    assert data["signal"][[0, 2], 0].tolist() == [1.25, -1.5]


@pytest.mark.parametrize("kind", ["null", "list"])
def test_a_feature_of_nulls_alone(tmp_path, kind):
    logs.write_lerobot(tmp_path / "pick", episodes=1)
    file = next((tmp_path / "pick" / "data").rglob("*.parquet"))
    table = pq.read_table(file)
    rows = table.num_rows
    nulls = pa.nulls(rows) if kind == "null" else pa.array([[None, None]] * rows, pa.list_(pa.null()))
    pq.write_table(table.set_column(0, "observation.state", nulls), file)
    source = lerobot_source(tmp_path / "pick")
    read = source.columns(["observation.state[hinge]", "observation.state[hinge.rate]", "action[motor]"])
    assert np.isnan(read["observation.state[hinge]"]).all()
    assert np.isnan(read["observation.state[hinge.rate]"]).all()
    assert not np.isnan(read["action[motor]"]).any()
