"""The swing-up of a cart-pole: a task for any cart-pole, and one on ``mujoco.batch``."""

from envs.swing_up.physics import DT, MODEL, PHYSICAL, cart_pole
from envs.swing_up.task import SwingUpTask, state_of

__all__ = ["DT", "MODEL", "PHYSICAL", "SwingUpTask", "cart_pole", "state_of"]
