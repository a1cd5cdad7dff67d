"""Control: planners that look ahead in the worlds that a belief holds possible."""

from onlinebayes.control.bounds import Bounds
from onlinebayes.control.cost import Cost, TaskCost
from onlinebayes.control.mppi import MPPI, Report
from onlinebayes.control.noise import Coloured, Knots, Noise, White
from onlinebayes.control.risk import CVaR, Mean, Risk, Unscented, WorstCase

__all__ = [
    "MPPI",
    "Bounds",
    "CVaR",
    "Coloured",
    "Cost",
    "Knots",
    "Mean",
    "Noise",
    "Report",
    "Risk",
    "TaskCost",
    "Unscented",
    "White",
    "WorstCase",
]
