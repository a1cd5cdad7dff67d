"""Conformance checks: what every simulator, effect and environment with theta must do, for tests of those you write.

check_engine(MyEngine(space), commands=1)                                                    # what learning needs
check_simulator(MujocoSimulator("arm.xml", space))                                           # and what logs need
check_effect(MujocoSimulator("arm.xml", space), DryFriction("elbow", Parameter(0.0, 1.0, "N m")))
check_env(lambda: SimulatorEnv(MujocoSimulator("arm.xml", space, worlds=4), task))
check_parameterized(lambda: Parameterized(GymEnv("Pendulum-v1"), space, apply), space)
"""

from onlinebayes.simulators.testing.effect import check_effect
from onlinebayes.simulators.testing.engine import check_engine
from onlinebayes.simulators.testing.env import check_env
from onlinebayes.simulators.testing.parameterized import check_parameterized
from onlinebayes.simulators.testing.simulator import check_simulator

__all__ = ["check_effect", "check_engine", "check_env", "check_parameterized", "check_simulator"]
