"""The Fetch arm of Gymnasium-Robotics as batched worlds: Reach, Push, Slide."""

from envs.fetch.model import FRICTION, PHYSICAL, Scene, scene
from envs.fetch.pusher import ScriptedPusher
from envs.fetch.simulator import FetchSimulator
from envs.fetch.task import FetchTask, motion

__all__ = ["FRICTION", "PHYSICAL", "FetchSimulator", "FetchTask", "Scene", "ScriptedPusher", "motion", "scene"]
