"""Two names of one law are a tie, whatever a coarse step makes of each."""

from __future__ import annotations

from dataclasses import replace

from onlinebayes.criticism import Selection, refine
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.search import search
from onlinebayes.criticism.searching.ties import alternatives
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


def test_an_equal_that_its_round_did_not_refit_is_found_at_the_final_model() -> None:
    effects = ["viscous_friction", "back_emf", "dry_friction", "quadratic_drag"]
    model = MujocoSimulator(PENDULUM.xml, MASS, threads=1)
    measurement = PENDULUM.measure(RUBBING, runs=10)
    found = search(model, SearchContext(measurement, Selection(), effects), 1)
    ((stage, first),) = found.accepted
    alone = replace(stage, judged=(first,))
    (others,) = alternatives(model, replace(found, stages=(alone,), accepted=((alone, first),)), None).values()
    assert {first.effect.key, *others} == {"viscous_friction@hinge", "back_emf@motor"}
