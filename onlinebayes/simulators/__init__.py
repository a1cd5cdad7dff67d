"""Simulators: many worlds at once, each with its own physical parameters."""

from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.drawing import Drawable, Shape
from onlinebayes.simulators.env import SimulatorEnv
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.parameterized import Parameterized
from onlinebayes.simulators.stepping import Actuator, Joint
from onlinebayes.simulators.task import GoalTask, Task
from onlinebayes.simulators.torch import TorchSimulator

__all__ = [
    "Actuator",
    "Drawable",
    "GoalTask",
    "Identifiable",
    "Joint",
    "Parameterized",
    "Shape",
    "Simulator",
    "SimulatorEnv",
    "Task",
    "TorchSimulator",
]
