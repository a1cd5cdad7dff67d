"""Trainers: the order of the steps, over parts that know no trainer."""

from onlinebayes.trainers.adaptive import AdaptivePlanner
from onlinebayes.trainers.checkpoint import Saver
from onlinebayes.trainers.collecting import collector_of
from onlinebayes.trainers.critic import Critic, Finding, LoggedRuns, SearchCritic, Weigher
from onlinebayes.trainers.env_problem import EnvPlayer, EnvProblem
from onlinebayes.trainers.excitation import Excited, HeldActions, Limits, range_of
from onlinebayes.trainers.following import Follower
from onlinebayes.trainers.growing import GrowingTrainer
from onlinebayes.trainers.hypotheses import OpenHypotheses, OpenHypothesis
from onlinebayes.trainers.improve import improve
from onlinebayes.trainers.journal import Journal
from onlinebayes.trainers.online import OnlineTrainer
from onlinebayes.trainers.playing import Episode, Player, SimulatedPlayer
from onlinebayes.trainers.policy_files import PolicyFiles
from onlinebayes.trainers.problem import Problem, Sizes, Worlds, online_trainer
from onlinebayes.trainers.real import Background, GrowingFolder, RealEnvironment, RealSystem, SystemFailed
from onlinebayes.trainers.recording import Recording
from onlinebayes.trainers.repeated import Repeated
from onlinebayes.trainers.schedule import Schedule, Turn
from onlinebayes.trainers.session import run_in_folder
from onlinebayes.trainers.simulations import Listed, Point, Simulations, TrajectorySource
from onlinebayes.trainers.state import OnlineState, Record
from onlinebayes.trainers.trajectories import Policy, TrajectoryFormat, returns, trajectories

__all__ = [
    "AdaptivePlanner",
    "Background",
    "Critic",
    "EnvPlayer",
    "EnvProblem",
    "Episode",
    "Excited",
    "Finding",
    "Follower",
    "GrowingFolder",
    "GrowingTrainer",
    "HeldActions",
    "Journal",
    "Limits",
    "Listed",
    "LoggedRuns",
    "OnlineState",
    "OnlineTrainer",
    "OpenHypotheses",
    "OpenHypothesis",
    "Player",
    "Point",
    "Policy",
    "PolicyFiles",
    "Problem",
    "RealEnvironment",
    "RealSystem",
    "Record",
    "Recording",
    "Repeated",
    "Saver",
    "Schedule",
    "SearchCritic",
    "SimulatedPlayer",
    "Simulations",
    "Sizes",
    "SystemFailed",
    "TrajectoryFormat",
    "TrajectorySource",
    "Turn",
    "Weigher",
    "Worlds",
    "collector_of",
    "improve",
    "online_trainer",
    "range_of",
    "returns",
    "run_in_folder",
    "trajectories",
]
