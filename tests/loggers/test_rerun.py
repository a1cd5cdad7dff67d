"""The recording is read back: what was logged stands in it, at the step it was logged at."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.loggers import RerunLogger
from onlinebayes.runs import BadInput


def read(path: Path) -> dict[str, list[pa.RecordBatch]]:
    """Entity path -> its chunks."""
    from rerun.chunk import RrdReader

    found: dict[str, list[pa.RecordBatch]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        found.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    return found


def column(batches: list[pa.RecordBatch], name: str) -> list:
    """The values of one component or time line (s) over all chunks that have it."""
    found = []
    for batch in batches:
        for full in batch.schema.names:
            if full == name or full.endswith(f":{name}"):
                values = batch.column(full)
                found += (seconds(values) if pa.types.is_duration(values.type) else values).to_pylist()
    assert found, f"no {name}"
    return found


def seconds(durations: pa.Array) -> pa.Array:
    """Whole nanoseconds have no Python object unless pandas is there: a plain number has."""
    return pc.divide(durations.cast(pa.duration("ns")).cast(pa.int64()).cast(pa.float64()), 1e9)


def test_scalars_stand_at_their_steps(tmp_path: Path) -> None:
    logger = RerunLogger("run", tmp_path)
    logger.log_scalar("train/return", 1.5, step=10)
    logger.log_scalar("train/return", torch.tensor([2.5]), step=20)
    logger.log_scalar("counted", 7.0)
    logger.log_scalar("counted", 8.0)
    logger.shutdown()
    found = read(logger.path)
    assert column(found["/train/return"], "step") == [10, 20]
    assert column(found["/train/return"], "scalars") == [[1.5], [2.5]]
    assert column(found["/counted"], "step") == [0, 1]


def test_metrics_of_a_tensordict_become_folders(tmp_path: Path) -> None:
    logger = RerunLogger("run", tmp_path)
    logger.log_metrics(TensorDict({"loss": {"actor": torch.tensor(3.0)}}), step=4)
    logger.shutdown()
    assert column(read(logger.path)["/loss/actor"], "scalars") == [[3.0]]


def test_histogram_keeps_every_finite_value(tmp_path: Path) -> None:
    logger = RerunLogger("run", tmp_path)
    logger.log_histogram("weights", torch.tensor([0.0, 0.1, 0.9, float("nan")]), bins=2, step=3)
    logger.shutdown()
    batches = read(logger.path)["/weights"]
    (values,) = column(batches, "values")
    assert np.asarray(values[0]["buffer"]).tolist() == [2, 1]
    assert column(batches, "step") == [3]


@pytest.mark.parametrize("shape", [(3, 1, 8, 8), (1, 3, 3, 8, 8)])
def test_video_frames_are_images_in_time(tmp_path: Path, shape: tuple[int, ...]) -> None:
    logger = RerunLogger("run", tmp_path)
    logger.log_video("view", torch.rand(shape), step=5, fps=10)
    logger.log_scalar("after", 1.0, step=6)
    logger.shutdown()
    found = read(logger.path)
    assert column(found["/view"], "video") == pytest.approx([0.0, 0.1, 0.2])
    assert column(found["/view"], "step") == [5, 5, 5]
    assert "video" not in found["/after"][0].schema.names


def test_video_of_two_colours_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="2 colours"):
        RerunLogger("run", tmp_path).log_video("view", torch.zeros(1, 2, 4, 4))


def test_settings_are_a_table(tmp_path: Path) -> None:
    logger = RerunLogger("run", tmp_path)
    logger.log_hparams({"lr": 1e-3, "choice": "a|b"})
    logger.shutdown()
    ((text,),) = column(read(logger.path)["/hparams"], "text")
    assert "| lr | 0.001 |" in text
    assert r"a\|b" in text


def test_a_second_run_keeps_the_first(tmp_path: Path) -> None:
    first = RerunLogger("run", tmp_path)
    second = RerunLogger("run", tmp_path)
    assert (first.path.name, second.path.name) == ("run.rrd", "run-2.rrd")


def test_counters_survive_a_checkpoint(tmp_path: Path) -> None:
    logger = RerunLogger("run", tmp_path)
    logger.log_scalar("loss", 1.0, step=41)
    again = RerunLogger("run", tmp_path)
    again.load_state_dict(logger.state_dict())
    again.log_scalar("loss", 2.0)
    again.shutdown()
    assert column(read(again.path)["/loss"], "step") == [42]


def test_bad_places_are_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="choose a folder"):
        RerunLogger("run", tmp_path / "file" / "sub")
    with pytest.raises(BadInput, match="slash"):
        RerunLogger("a/b", tmp_path)


def test_a_full_disk_is_said_and_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    logger = RerunLogger("run", tmp_path)
    logger.log_scalar("return", 1.0)
    room = shutil.disk_usage(tmp_path)
    with monkeypatch.context() as full:
        full.setattr(shutil, "disk_usage", lambda _: room._replace(free=1000))
        with pytest.raises(BadInput, match="cannot be written: No space left on device; make room"):
            logger.shutdown()
