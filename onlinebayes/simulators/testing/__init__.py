"""Conformance checks: what every simulator, effect and environment with theta must do, for tests of those you write.

check_simulator(MujocoSimulator("arm.xml", space))
check_effect(MujocoSimulator("arm.xml", space), DryFriction("elbow", Parameter(0.0, 1.0, "N m")))
check_parameterized(lambda: Parameterized(GymEnv("Pendulum-v1"), space, apply), space)
"""

from onlinebayes.simulators.testing.effect import check_effect
from onlinebayes.simulators.testing.parameterized import check_parameterized
from onlinebayes.simulators.testing.simulator import check_simulator

__all__ = ["check_effect", "check_parameterized", "check_simulator"]
