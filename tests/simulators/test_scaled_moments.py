"""Moments of inertia that follow a free mass: the same body, denser."""

from __future__ import annotations

import mujoco
import pytest
import torch

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

ROD = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body name="base">
<joint name="rail" type="slide" axis="1 0 0"/><geom size=".05" mass="1"/><body name="rod">
<joint name="hinge" axis="0 1 0" damping="0.01"/>
<geom type="capsule" fromto="0 0 0 0.1 0 -.4" size=".02" mass="{mass}"/>
</body></body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
MASS = {"body.rod.mass": Parameter(0.1, 3.0, "kg")}


def rod(more: dict[str, Parameter] | None = None, mass: float = 0.5) -> MujocoSimulator:
    return MujocoSimulator(ROD.format(mass=mass), ParameterSpace({**MASS, **(more or {})}), threads=1)


def test_a_denser_rod_is_what_mujoco_makes_of_a_heavier_geom() -> None:
    fields = rod().with_scaled_moments().fields(torch.tensor([[0.5], [0.8]], dtype=torch.float64).numpy())
    for world, mass in enumerate((0.5, 0.8)):
        model = mujoco.MjModel.from_xml_string(ROD.format(mass=mass))
        assert fields["body_mass"][world] == pytest.approx(model.body_mass, rel=1e-12)
        assert fields["body_inertia"][world] == pytest.approx(model.body_inertia, rel=1e-12)


def test_at_the_model_s_own_mass_nothing_changes_bit_for_bit() -> None:
    own = rod()
    fields = own.with_scaled_moments().fields(own.nominal[None].numpy())
    assert (fields["body_inertia"][0] == own.model.body_inertia).all()


def test_the_exported_model_has_these_moments() -> None:
    model = mujoco.MjModel.from_xml_string(
        rod().with_scaled_moments().export_xml(torch.tensor([0.8], dtype=torch.float64))
    )
    heavier = mujoco.MjModel.from_xml_string(ROD.format(mass=0.8))
    assert model.body_inertia[2] == pytest.approx(heavier.body_inertia[2], rel=1e-12)


@pytest.mark.parametrize("free", [{"body.rod.inertia[0]": Parameter(0.001, 0.1, "kg m2")}, {}])
def test_it_is_the_same_simulator_where_no_moment_would_follow(free: dict[str, Parameter]) -> None:
    """Moments that are free themselves stay so; a body that only slides shows none."""
    parameters = ParameterSpace({**MASS, **free} if free else {"body.base.mass": Parameter(0.1, 3.0, "kg")})
    simulator = MujocoSimulator(ROD.format(mass=0.5), parameters, threads=1)
    assert simulator.with_scaled_moments() is simulator
