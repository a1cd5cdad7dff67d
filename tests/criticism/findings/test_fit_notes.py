"""What is said of accepted laws that are, by their equations, others."""

from onlinebayes.criticism.findings.fit_notes import of_sums
from onlinebayes.parameters import Parameter
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
