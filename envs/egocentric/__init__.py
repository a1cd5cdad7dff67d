"""Choice of a sensor on an energy budget (thesis, chapter 3): recorded activities, a phone's battery, the choice."""

from envs.egocentric.cost import CameraCost
from envs.egocentric.motion import MotionPredictor, cross_fitted, features, fit_motion, predicted
from envs.egocentric.phone import CURRENTS, Phone
from envs.egocentric.recorded import (
    MOTION,
    VISION,
    PolicyRun,
    Recorded,
    made_up_predictions,
    read_policy_run,
    read_predictions,
)
from envs.egocentric.sequences import CLASSES, Sequences, made_up, read_sequences
from envs.egocentric.task import SensorChoice, Stretches, gain

__all__ = [
    "CLASSES",
    "CURRENTS",
    "MOTION",
    "VISION",
    "CameraCost",
    "MotionPredictor",
    "Phone",
    "PolicyRun",
    "Recorded",
    "SensorChoice",
    "Sequences",
    "Stretches",
    "cross_fitted",
    "features",
    "fit_motion",
    "gain",
    "made_up",
    "made_up_predictions",
    "predicted",
    "read_policy_run",
    "read_predictions",
    "read_sequences",
]
