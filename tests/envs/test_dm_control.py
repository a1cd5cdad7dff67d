"""Tasks of the dm_control suite: the suite's own at the model's values, other physics at others."""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torchrl.envs import SerialEnv, TransformedEnv

from envs.dm_control import suite
from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Parameterized
from onlinebayes.simulators.testing import check_parameterized
from onlinebayes.transforms import ParameterRandomization

dm_suite = pytest.importorskip("dm_control.suite")

SPACES = {
    "cartpole-swingup": ParameterSpace(
        {
            "body.pole_1.mass": Parameter(0.05, 0.5, "kg"),
            "joint.hinge_1.damping": Parameter(0.0, 0.1, "N m s/rad"),
            "actuator.slide.gear": Parameter(5.0, 20.0, "N"),
        }
    ),
    "walker-walk": ParameterSpace(
        {
            "body.*_thigh.mass": Parameter(1.0, 10.0, "kg"),
            "geom.floor.friction[0]": Parameter(0.3, 1.5),
            "option.gravity[2]": Parameter(-12.0, -8.0, "m/s2"),
            "option.density": Parameter(0.0, 2.0, "kg/m3"),
        }
    ),
}


def make(name: str) -> Parameterized:
    return suite(name, SPACES[name], seed=0, seconds=1.0)


def model_of(env: Parameterized) -> mujoco.MjModel:
    return env.base_env.base_env._env.physics.model.ptr


@pytest.mark.parametrize("name", SPACES)
def test_conforms(name: str) -> None:
    check_parameterized(partial(make, name), SPACES[name])


@pytest.mark.parametrize("name", SPACES)
def test_at_the_models_own_values_it_is_the_suites_task(name: str) -> None:
    env = make(name)
    plain = dm_suite.load(*name.split("-"), task_kwargs={"random": 0})
    env.set_seed(3)
    plain.task._random = np.random.RandomState(3)
    plain.reset()  # TorchRL resets once when it sets a seed
    state, step = env.reset(), plain.reset()
    for _ in range(20):
        assert state["observation"].tolist() == np.float32(
            np.concatenate([np.atleast_1d(part) for part in step.observation.values()])
        ).tolist()  # fmt: skip
        state = env.rand_action(state)
        step = plain.step(state["action"].double().numpy())
        state = env.step(state)["next"]
        assert float(state["reward"]) == pytest.approx(step.reward, rel=1e-6)


def test_specs_are_those_of_one_world_in_single_precision() -> None:
    env = make("walker-walk")
    assert env.observation_spec["observation"].shape == (24,)
    assert {env.observation_spec["observation"].dtype, env.action_spec.dtype, env.reward_spec.dtype} == {torch.float32}
    assert env.observation_spec["theta"].dtype == torch.float64
    assert set(env.observation_spec.keys()) == {"observation", "theta"}


def test_constants_follow_the_parameters_and_come_back_with_them() -> None:
    env = make("cartpole-swingup")
    own = env.reset()["theta"]
    assert own.tolist() == [0.1, model_of(env).dof_damping[1], model_of(env).actuator_gear[0, 0]]
    names = ("body_subtreemass", "dof_M0", "dof_invweight0", "body_invweight0", "actuator_acc0")
    before = [getattr(model_of(env), name).copy() for name in names]
    env.reset(TensorDict({"theta": torch.tensor([0.4, 0.05, 8.0]).double()}))
    assert model_of(env).body_subtreemass[0] == pytest.approx(1.4)
    env.reset(TensorDict({"theta": own}))
    for name, value in zip(names, before, strict=True):
        assert np.array_equal(getattr(model_of(env), name), value), name


def test_several_worlds_each_with_its_own_physics() -> None:
    space = SPACES["cartpole-swingup"]
    beside = SerialEnv(3, partial(suite, "cartpole-swingup", space, seconds=0.05))
    env = TransformedEnv(beside, ParameterRandomization(BoxUniform(space)))
    data = env.rollout(12, break_when_any_done=False)
    assert data["next", "truncated"][:, [4, 9], 0].all()
    assert data["theta"][:, ::5].reshape(-1, 3).unique(dim=0).shape[0] == 9
    for i, world in enumerate(beside._envs):
        assert [world.base_env.base_env._env.physics.model.ptr.body_mass[2]] == data["theta"][i, -1:, 0].tolist()


def test_a_model_outside_the_bounds_starts_at_the_nearest_one() -> None:
    space = ParameterSpace({"body.pole_1.mass": Parameter(0.3, 0.5, "kg")})
    assert suite("cartpole-swingup", space).reset()["theta"].tolist() == [0.3]


@pytest.mark.parametrize(
    ("name", "addresses", "said"),
    [
        ("cartpole-swing", ["body.pole_1.mass"], "no task 'cartpole-swing'.*cartpole-swingup"),
        ("cartpole-swingup", ["body.pole.mass"], "no body 'pole'.*pole_1"),
        ("cartpole-swingup", ["body.pole_1.mass", "body.*.mass"], "are the same value"),
        ("cartpole-swingup", ["body.pole_1.ipos[2]"], "cannot be changed in a compiled model"),
    ],
)
def test_bad_input(name: str, addresses: list[str], said: str) -> None:
    with pytest.raises(BadInput, match=said):
        suite(name, ParameterSpace({address: Parameter(0.1, 1.0) for address in addresses}))
