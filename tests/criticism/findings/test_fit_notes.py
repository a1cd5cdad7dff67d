"""What is said of accepted laws that are, by their equations, others, and of values on their bounds."""

from dataclasses import replace

from onlinebayes.criticism.findings.fit_notes import of_bounds, of_sums
from onlinebayes.identification.results import Estimate
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import AsymmetricFriction, ConstantLoad, DryFriction

FORCE = Parameter(0.0, 5.0, "N")
EITHER = Parameter(-5.0, 5.0, "N")


def test_friction_that_depends_on_direction_is_friction_and_a_load() -> None:
    (note,) = of_sums([AsymmetricFriction("rail", FORCE, FORCE)])
    assert "asymmetric_friction@rail is by its equation dry_friction@rail and constant_load@rail together" in note
    (note,) = of_sums([DryFriction("rail", FORCE), ConstantLoad("rail", EITHER)])
    assert "dry_friction@rail and constant_load@rail are by their equation asymmetric_friction@rail" in note


def test_friction_and_a_load_at_other_joints_are_two_things() -> None:
    assert not list(of_sums([DryFriction("rail", FORCE), ConstantLoad("hinge", EITHER)]))
    assert not list(of_sums([DryFriction("rail", FORCE)]))


def test_a_value_on_its_bound_is_said_where_the_data_determine_it() -> None:
    """The mass of what falls moves nothing: its fit ends anywhere, also on a bound."""
    space = ParameterSpace({"body.box.mass": Parameter(1.0, 10.0, "kg")})
    mass = Estimate(10.0, 0.1, 9.8, 10.0, "kg", at_bound="high")
    (note,) = of_bounds(space, {"body.box.mass": mass})
    assert note.startswith("body.box.mass ends on its bound of 10 kg: the data may ask for more")
    assert not list(of_bounds(space, {"body.box.mass": replace(mass, identifiable=False)}))
    assert not list(of_bounds(space, {"body.box.mass": replace(mass, at_bound=None)}))
