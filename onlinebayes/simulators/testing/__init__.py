"""Conformance checks: what every simulator and every effect must do, for the tests of those you write yourself.

check_simulator(MujocoSimulator("arm.xml", space))
check_effect(MujocoSimulator("arm.xml", space), DryFriction("elbow", Parameter(0.0, 1.0, "N m")))
"""

from onlinebayes.simulators.testing.effect import check_effect
from onlinebayes.simulators.testing.simulator import check_simulator

__all__ = ["check_effect", "check_simulator"]
