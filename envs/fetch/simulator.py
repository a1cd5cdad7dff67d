r"""Worlds of the Fetch arm: a command moves the hand by up to 5 cm a step, and friction differs from world to world.

    mocap = hand + 0.05 u,     u (N, 3) in [-1, 1];   20 timesteps of 2 ms;   then the fingers are put back to 0

| key of a state            | shape   | meaning                                                                     |
|---------------------------|---------|-----------------------------------------------------------------------------|
| ``"qpos"``, ``"qvel"``    | nq, nv  | of arm and object                                                           |
| ``"qacc_warmstart"``      | nv      | where the constraint solver starts from                                     |
| ``"grip"``                | 6       | the gripper's place and velocity [m, m/s]; read, never set                  |
| ``"object"``              | 12      | its place, Euler angles, velocity, angular velocity; read, never set        |

The same numbers as Gymnasium-Robotics to the last bits (tests compare 16 worlds over 50 steps).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self, final

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from envs.fetch.model import GRIP, HAND, HAND_TURN, OBJECT, SUBSTEPS, Scene
from envs.fetch.sites import Site
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Shape, Simulator
from onlinebayes.simulators.by_steps import by_steps
from onlinebayes.simulators.checks import refuse_twice
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.mujoco import drawing
from onlinebayes.simulators.mujoco.host import to_host
from onlinebayes.simulators.mujoco.pictures import Renderer
from onlinebayes.simulators.mujoco.system import MujocoSystem
from onlinebayes.simulators.mujoco.worlds import Worlds

REACH = 0.05
"""Distance by which a command of 1 pulls the hand [m]."""


@final
class FetchSimulator(Simulator):
    """N worlds of one scene.

    Args:
        scene: model and posture, of :func:`~envs.fetch.model.scene`.
        parameters: the free ones, by address; :data:`~envs.fetch.model.FRICTION` is the one that matters.
        worlds: number of worlds N.
        threads: threads that step them, 0 for all cores.
        effects: that MuJoCo has itself, as joints' friction.
    """

    def __init__(
        self,
        scene: Scene,
        parameters: ParameterSpace | None = None,
        worlds: int = 1,
        threads: int = 0,
        effects: Sequence[Effect] = (),
    ) -> None:
        system = MujocoSystem(scene.spec, parameters or ParameterSpace(), effects)
        for effect in (*system.staged, *system.stages):
            raise BadInput(f"{effect.key} has no form in the Fetch worlds", "add an effect that MuJoCo has itself")
        self.scene = scene
        self._populate(system, worlds, threads)

    def _populate(self, system: MujocoSystem, worlds: int, threads: int) -> None:
        if worlds < 1:
            raise BadInput(f"worlds = {worlds}", "a simulator has at least one world")
        self._system, self._threads, self.worlds = system, threads, worlds
        self.parameters = system.parameters
        self.dt, self.device, self.dtype = SUBSTEPS * system.model.opt.timestep, torch.device("cpu"), torch.float64
        self._worlds, model = Worlds(system, worlds, threads), system.model
        bind = self._worlds.batch.bind
        self._mocap_place, self._mocap_turn = bind("mocap_pos")[:, 0], bind("mocap_quat")[:, 0]
        hand = model.body(HAND).id
        self._hand_place, self._hand_turn = bind("xpos")[:, hand], bind("xquat")[:, hand]
        self._grip = Site(self._worlds.batch, model, GRIP)
        self._object = None if self.scene.object_column is None else Site(self._worlds.batch, model, OBJECT)
        self._no_command = np.zeros((worlds, model.nu))
        self._renderers: dict[tuple[int, int], Renderer] = {}
        self._theta = self.nominal.expand(worlds, -1).clone()
        self.reset(self._theta)

    @property
    def nominal(self) -> Float[Tensor, " P"]:
        """The model file's own values."""
        return self._system.nominal

    @property
    def theta(self) -> Float[Tensor, "N P"]:
        """A copy of every world's parameters."""
        return self._theta.clone()

    @property
    def failed(self) -> Bool[Tensor, " N"]:
        """Worlds that the engine warned about since their last reset."""
        return torch.from_numpy(self._worlds.failed.copy())

    @property
    def state(self) -> TensorDict:
        """A copy of the complete state of all worlds."""
        state = self._worlds.read_state()
        grip, thing = self._grip, self._object
        state["grip"] = torch.from_numpy(np.concatenate([grip.place(), grip.velocity()], axis=-1))
        if thing is not None:
            seen = [thing.place(), thing.euler(), thing.velocity(), thing.angular_velocity()]
            state["object"] = torch.from_numpy(np.concatenate(seen, axis=-1))
        return state

    def reset(
        self,
        theta: Float[Tensor, "N P"],
        state: TensorDictBase | None = None,
        mask: Bool[Tensor, " N"] | None = None,
    ) -> TensorDict:
        """New parameters and states for the worlds under ``mask``; see :meth:`Simulator.reset`."""
        ids = None if mask is None or bool(mask.all()) else to_host(mask).nonzero()[0].astype(np.int32)
        if ids is not None and not len(ids):
            return self.state
        rows = slice(None) if ids is None else torch.from_numpy(ids).long()
        values = theta[rows].detach().to("cpu", torch.float64)
        if not bool(values.isfinite().all()):
            raise BadInput("theta is not finite", "give every parameter a finite value")
        self._theta[rows] = values
        self._worlds.revive(ids)
        self._worlds.write_theta(to_host(values), ids)
        self._worlds.write_state(self._begun(state), ids)
        self._worlds.look()
        return self.state

    def _begun(self, state: TensorDictBase | None) -> TensorDict:
        """Complete a state: the scene's posture for all that it lacks."""
        start = {"qpos": self.scene.qpos, "qvel": self.scene.qvel}
        rest = {key: torch.from_numpy(row).expand(self.worlds, -1) for key, row in start.items()}
        given = {} if state is None else dict(state.select(*self._system.record.columns, strict=False).items())
        return TensorDict({**rest, **given}, batch_size=(self.worlds,))

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """Advance every world that has not failed by ``dt``."""
        command = to_host(inputs.get("command").to(torch.float64))
        self._mocap_place[...] = self._hand_place + REACH * command
        self._mocap_turn[...] = self._hand_turn + np.array(HAND_TURN)
        self._worlds.hold(self._no_command, SUBSTEPS)
        self._worlds.put("qpos", self.scene.fingers, 0.0)
        self._worlds.look()
        return self.state

    def rollout(
        self,
        theta: Float[Tensor, "M P"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """Trajectories of M worlds; see :meth:`Simulator.rollout`. A timestep is ``dt``."""
        return by_steps(self, theta, state, inputs, times)

    def with_effect(self, effect: Effect) -> Self:
        """A new simulator with this effect; see :meth:`Simulator.with_effect`."""
        refuse_twice(effect, self._system.effects)
        effects = (*self._system.effects, effect)
        return type(self)(self.scene, self._system.base_parameters, self.worlds, self._threads, effects)

    def with_worlds(self, worlds: int) -> Self:
        """A new simulator with another number of worlds, all nominal and in the scene's posture."""
        other = object.__new__(type(self))
        other.scene = self.scene
        other._populate(self._system, worlds, self._threads)
        return other

    def snapshot(self) -> dict[str, Any]:
        """Return the state of all worlds, the engine's warm start included."""
        return {"theta": self._theta.clone(), **self._worlds.snapshot()}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Stand where a snapshot was taken."""
        self._theta = snapshot["theta"].clone()
        self._worlds.write_theta(to_host(self._theta))
        self._worlds.restore(snapshot)
        self._worlds.look()

    def __reduce__(self) -> tuple[Any, ...]:
        """For processes of their own: the arguments, and where it stands."""
        base, effects = self._system.base_parameters, self._system.effects
        return _remake, ((self.scene, base, self.worlds, self._threads, effects), self.snapshot())

    def shapes(self, theta: Float[Tensor, " P"]) -> tuple[Shape, ...]:
        """The model's visible geoms; see :class:`~onlinebayes.simulators.Drawable`."""
        return drawing.shapes(self._system.model)

    def poses(self, theta: Float[Tensor, " P"], states: TensorDictBase) -> Float[Tensor, "T S 7"]:
        """Return the poses of the shapes."""
        return drawing.poses(self._system.model, to_host(states.get("qpos")))

    def picture(
        self,
        theta: Float[Tensor, " P"],
        state: TensorDictBase,
        size: tuple[int, int],
        beside: tuple[Sequence[Shape], Float[Tensor, "S 7"]],
    ) -> UInt8[np.ndarray, "H W 3"]:
        """A world by MuJoCo's renderer; see :class:`~onlinebayes.simulators.pictures.Pictured`."""
        if size not in self._renderers:
            self._renderers[size] = Renderer(self._system, size)
        return self._renderers[size].picture(theta, state, beside)


def _remake(arguments: tuple[Any, ...], snapshot: dict[str, Any]) -> FetchSimulator:
    """The simulator that was taken apart for a pickle."""
    made = FetchSimulator(*arguments)
    made.restore(snapshot)
    return made
