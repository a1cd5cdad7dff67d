"""A TorchRL logger that writes one Rerun recording (``.rrd``), to be opened with ``rerun FILE``.

| call               | entity      | archetype                       | time lines              |
|--------------------|-------------|---------------------------------|-------------------------|
| ``log_scalar``     | ``name``    | Scalars                         | ``step``                |
| ``log_histogram``  | ``name``    | BarChart of the counts          | ``step``                |
| ``log_video``      | ``name``    | one JPEG image a frame          | ``step``, ``video``     |
| ``log_hparams``    | ``hparams`` | TextDocument, a Markdown table  | none: it always applies |

A slash in a name makes a folder: ``train/return`` and ``train/loss`` are drawn together. The file grows while the run
lasts and can be watched then; a run never overwrites the recording of another.

Source of the interface: TorchRL's ``torchrl.record.loggers.Logger``; of the format: https://rerun.io/docs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from jaxtyping import Shaped
from torch import Tensor
from torchrl.record.loggers import Logger

from onlinebayes.runs import BadInput, check_room

if TYPE_CHECKING:
    from rerun import RecordingStream


class RerunLogger(Logger):
    """Writes ``log_dir/exp_name.rrd``; if that is taken, ``exp_name-2.rrd`` and so on.

    Args:
        exp_name: name of the run, without a slash; also what the viewer calls the application.
        log_dir: folder of the recording; made if it is missing.
        fps: frames per second of :meth:`log_video` unless the call says otherwise [1/s].

    Attributes:
        path: the recording.

    Raises:
        BadInput: the folder cannot be made.
    """

    experiment: RecordingStream

    def __init__(self, exp_name: str, log_dir: str | Path = "runs", *, fps: float = 30.0) -> None:
        self.fps = fps
        self._next: dict[str, int] = defaultdict(int)
        try:
            Path(log_dir).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInput(
                f"cannot write here: {error.strerror}", "choose a folder you may write to", where=str(log_dir)
            ) from error
        self.path = _free(Path(log_dir), exp_name)
        super().__init__(exp_name, str(log_dir))

    def _create_experiment(self) -> RecordingStream:
        import rerun as rr  # 0.7 s: only when a recording is wanted

        stream = rr.RecordingStream(self.exp_name)
        stream.save(self.path)
        return stream

    def log_scalar(self, name: str, value: float | Tensor, step: int | None = None) -> None:
        """Add one value of a curve.

        Args:
            name: entity path, e.g. ``"train/return"``.
            value: a number, or a tensor of one element.
            step: place on the time line ``step``; without one, the number of earlier calls with this name.
        """
        import rerun as rr

        self._log(name, rr.Scalars(float(value)), step)

    def log_histogram(self, name: str, data: Sequence[float] | Tensor, **kwargs: Any) -> None:
        """Add the histogram of a sample.

        Args:
            name: entity path.
            data: the sample, flattened; values that are not finite are left out.
            **kwargs: ``step``, as in :meth:`log_scalar`; ``bins``: number of bins or their edges, as in
                ``numpy.histogram`` ("auto" without it).
        """
        import rerun as rr

        sample = torch.as_tensor(data).detach().cpu().double().flatten().numpy()
        counts, edges = np.histogram(sample[np.isfinite(sample)], bins=kwargs.get("bins", "auto"))
        centres, widths = (edges[:-1] + edges[1:]) / 2, np.diff(edges)
        self._log(name, rr.BarChart(counts, abscissa=centres, widths=widths), kwargs.get("step"))

    def log_video(self, name: str, video: Shaped[Tensor, "*N T C H W"], step: int | None = None, **kwargs: Any) -> None:
        """Add frames, one JPEG image each.

        Args:
            name: entity path.
            video: frames (T, C, H, W) or (N, T, C, H, W) with one or three colours; integers in 0..255, or floats in
                0..1. Several videos play one after the other.
            step: as in :meth:`log_scalar`; all frames have the same.
            **kwargs: ``fps`` [1/s].

        Raises:
            ValueError: another number of colours.
        """
        import rerun as rr

        frames = video.detach().flatten(0, -4) if video.ndim > 4 else video.detach()
        if frames.shape[-3] not in (1, 3):
            raise ValueError(f"{frames.shape[-3]} colours, axis -3 of {tuple(video.shape)}; give 1 or 3")
        if frames.is_floating_point():
            frames = (frames.clamp(0, 1) * 255).round()
        pixels = frames.to("cpu", torch.uint8).permute(0, 2, 3, 1).expand(-1, -1, -1, 3).numpy()
        step = self._step(name, step)
        for k, frame in enumerate(pixels):
            self.experiment.set_time("video", duration=k / kwargs.get("fps", self.fps))
            self._log(name, rr.Image(frame).compress(jpeg_quality=85), step)
        self.experiment.disable_timeline("video")

    def log_hparams(self, cfg: Mapping[str, Any]) -> None:
        """Show the run's settings as a table: name and value."""
        import rerun as rr

        rows = [f"| {key} | {str(value).replace('|', chr(92) + '|')} |" for key, value in sorted(cfg.items())]
        text = "\n".join(["| setting | value |", "|---|---|", *rows])
        self.experiment.log("hparams", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)

    def shutdown(self, timeout: float | None = None) -> None:
        """Write what is pending and close the file."""
        super().shutdown(timeout)
        check_room(self.path)
        self.experiment.disconnect()

    def __repr__(self) -> str:
        return f"RerunLogger({str(self.path)!r})"

    def _log(self, name: str, content: Any, step: int | None) -> None:
        self.experiment.set_time("step", sequence=self._step(name, step))
        self.experiment.log([*name.split("/")], content)

    def _step(self, name: str, step: int | None) -> int:
        step = self._next[name] if step is None else int(step)
        self._next[name] = step + 1
        return step

    def _checkpoint_state(self) -> dict[str, Any]:
        return {"next": dict(self._next)}

    def _load_checkpoint_state(self, state: Mapping[str, Any]) -> None:
        self._next.clear()
        self._next.update(state.get("next", {}))


def _free(folder: Path, name: str) -> Path:
    """The first of ``name.rrd``, ``name-2.rrd``, ... that does not exist."""
    if "/" in name:
        raise BadInput(f"experiment name '{name}' has a slash", "put the folder into log_dir")
    path, number = folder / f"{name}.rrd", 1
    while path.exists():
        number += 1
        path = folder / f"{name}-{number}.rrd"
    return path
