"""Two names of one law are a tie, whatever a coarse step makes of each."""

from __future__ import annotations

from onlinebayes.criticism import refine
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ViscousFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.wired import PENDULUM

MASS = ParameterSpace({"body.rod.mass": Parameter(0.3, 3.0, "kg")})
RUBBING = {ViscousFriction("hinge", Parameter(0.0, 1.0, "N m s/rad")): (0.15,)}


def test_back_emf_is_viscous_friction_though_euler_damps_only_one_of_them_implicitly() -> None:
    model = MujocoSimulator(PENDULUM.xml.replace("RK4", "Euler"), MASS, threads=1)
    result = refine(model, PENDULUM.measure(RUBBING, runs=10), candidates=["viscous_friction", "back_emf"])
    assert result.verdict == "tie"
    (first,) = (c for c in result.candidates if c.effect == result.accepted[0])
    assert {first.effect, *first.indistinguishable_from} == {"viscous_friction@hinge", "back_emf@motor"}
