"""Dry friction as MuJoCo's own constraint has it, for logs that a simulator wrote."""

from __future__ import annotations

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import EFFECTS, DryFriction, Scales
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.simulators.models import SLIDE

OWN = SLIDE.replace('axis="1 0 0"', 'axis="1 0 0" frictionloss="1"')
ONE = torch.ones(1, dtype=torch.float64)
RUBS = DryFriction("rail", Parameter(0.0, 2.0, "N"))


def path(simulator: MujocoSimulator, theta: Tensor) -> Tensor:
    """Positions under a sine."""
    times = simulator.dt * torch.arange(1, 301, dtype=torch.float64)
    inputs = TensorDict({"command": 3 * torch.sin(5 * times)[None, :, None]}, batch_size=(1, 300))
    state = TensorDict({"qpos": torch.zeros(1, 1), "qvel": torch.zeros(1, 1)}, batch_size=(1,))
    return simulator.rollout(theta, state, inputs, times)["qpos"]


def test_it_is_a_frictionloss_bit_for_bit() -> None:
    hard, own = MujocoSimulator(SLIDE).with_effect(RUBS), MujocoSimulator(OWN)
    soft = hard.with_soft_friction()
    assert torch.equal(path(soft, ONE[None]), path(own, ONE[None, :0]))
    assert not torch.allclose(path(hard, ONE[None]), path(own, ONE[None, :0]), rtol=0, atol=1e-4)


def test_the_refined_model_says_nothing_of_softness() -> None:
    model, own = (
        MujocoSimulator(SLIDE).with_effect(RUBS).with_soft_friction().export(ONE).compile(),
        MujocoSimulator(OWN),
    )
    assert np.array_equal(model.dof_frictionloss, own.model.dof_frictionloss)
    assert np.array_equal(model.dof_solref, own.model.dof_solref)
    assert np.array_equal(model.dof_solimp, own.model.dof_solimp)


def test_it_stays_through_other_changes() -> None:
    soft = MujocoSimulator(SLIDE).with_effect(RUBS).with_soft_friction()
    load = EFFECTS["constant_load"].scaled("rail", Scales(1.0, 1.0, 1.0, 0.01, "slide"))
    for other in (soft.with_timestep(0.001), soft.with_runge_kutta(), soft.with_worlds(2), soft.with_effect(load)):
        assert other.with_soft_friction() is other


def test_it_is_the_simulator_itself_where_mjcf_holds_no_such_friction() -> None:
    own = MujocoSimulator(OWN)
    assert own.with_soft_friction() is own
    grows = EFFECTS["load_dependent_friction"].scaled("rail", Scales(1.0, 1.0, 1.0, 0.01, "slide"))
    staged = MujocoSimulator(SLIDE).with_effect(RUBS).with_effect(grows)
    assert staged.with_soft_friction() is staged
