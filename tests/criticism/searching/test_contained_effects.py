"""Stribeck friction is seen beside the dry friction that it contains, and takes its place."""

from __future__ import annotations

import pytest

from onlinebayes.criticism import refine
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import StribeckFriction
from tests.criticism.wired import PENDULUM

FORCE = Parameter(0.0, 5.0, "N m")
STRIBECK = StribeckFriction("hinge", FORCE, FORCE, Parameter(0.01, 5.0, "rad/s", scale="log"))


@pytest.mark.long
def test_stribeck_friction_takes_the_place_of_dry_friction() -> None:
    hidden = {STRIBECK: (0.15, 0.4, 0.3)}
    result = refine(
        PENDULUM.model(), PENDULUM.measure(hidden, runs=12), candidates=["dry_friction", "stribeck_friction"]
    )
    assert result.accepted == ("stribeck_friction@hinge",)
    assert result.verdict == "missing_effect"
    assert result.remainder.status == "noise"
    means = {
        name.rsplit(".", 1)[1]: estimate.mean for name, estimate in result.parameters.items() if "stribeck" in name
    }
    assert means["coulomb"] == pytest.approx(0.15, rel=0.1)
    assert means["static"] == pytest.approx(0.4, rel=0.1)
    assert means["stribeck_velocity"] == pytest.approx(0.3, rel=0.15)
