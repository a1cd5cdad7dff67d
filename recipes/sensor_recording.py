"""One episode as a Rerun recording: what the sensors felt, which one was asked and whether it was right, the charge.

| entity                    | at                   | meaning                                               |
|---------------------------|----------------------|-------------------------------------------------------|
| ``signals/acc``, ``gyr``  | every tenth second   | norms of acceleration [m/s^2] and turning rate [rad/s] |
| ``choice/camera``         | every second         | 1 where the camera is asked                           |
| ``choice/leaning``        | every second         | log odds of the camera                                |
| ``right/motion``          | every second         | 1 where the motion predictor is right                 |
| ``right/camera``          | every second         | how often the camera is right in such a second        |
| ``energy/used``           | every second         | charge used since the start [mAh]                     |

The time line ``step`` counts readings, ten a second.
"""

from __future__ import annotations

from pathlib import Path

from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from envs.egocentric import Phone, Sequences, Stretches
from onlinebayes.loggers import RerunLogger

RATE = 10


def record(
    place: Path, sequences: Sequences, seen: Stretches, leaning: Float[Tensor, "E T"], theta: Float[Tensor, " 2"]
) -> Path:
    """Write ``episode.rrd`` of the stretch in which the policy changes its mind most often; returns the file.

    Args:
        place: its folder.
        sequences: all of them.
        seen: whole sequences that the policy looked at.
        leaning: log odds of the camera there.
        theta: the phone's currents [mA].
    """
    camera = (leaning > 0) & seen.there
    row = int((camera[:, 1:] != camera[:, :-1]).sum(1).argmax())
    (place / "episode.rrd").unlink(missing_ok=True)
    logger = RerunLogger("episode", place)
    signals = sequences.signals[seen.sequence[row]]
    phone = Phone()
    full = float(phone.reset(theta[None])["qpos"])
    for second in range(int(seen.length[row])):
        for reading in range(signals.shape[1]):
            step = RATE * second + reading
            logger.log_scalar("signals/acc", float(signals[second, reading, :3].norm()), step)
            logger.log_scalar("signals/gyr", float(signals[second, reading, 3:].norm()), step)
        told = {
            "choice/camera": float(camera[row, second]),
            "choice/leaning": float(leaning[row, second]),
            "right/motion": float(seen.motion_right[row, second]),
            "right/camera": float(seen.vision_rate[row, second]),
        }
        after = phone.step(TensorDict({"command": camera[row, second].double().view(1, 1)}, (1,)))
        for name, value in {**told, "energy/used": full - float(after["qpos"])}.items():
            logger.log_scalar(name, value, RATE * second)
    logger.shutdown()
    return logger.path
