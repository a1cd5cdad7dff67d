"""A simulator and its measurement with turns in place of quaternions, for everything that looks at scalar signals.

What a turn is relative to stands in :mod:`.data.chart`, how the measured orientations are followed in
:mod:`.data.orientation_path`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, Self

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.identification.data.chart import POSE, Chart, positions, turns
from onlinebayes.identification.data.coordinates import Rotation, renamed, rotations
from onlinebayes.identification.data.orientation_path import OrientationPath, read_path, unrolled
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.replaying.wrapper import SimulatorWrapper
from onlinebayes.identification.splitting import origin
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.abilities import InFile
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import TargetKind
from onlinebayes.simulators.identifiable import Identifiable


class ChartedSimulator(SimulatorWrapper):
    """The worlds of ``physics`` with turns in place of quaternions.

    By itself it counts turns from no rotation at all; a replay counts them from what was measured (:meth:`along`).

    Args:
        physics: a simulator with free or ball joints.
        paths: run -> the measured path of each of them.
    """

    def __init__(self, physics: Identifiable, paths: Mapping[str, tuple[OrientationPath, ...]]) -> None:
        super().__init__(physics)
        self.paths, self.turning = paths, rotations(physics.signals)
        self.parameters = physics.parameters
        self.signals = tuple(renamed(physics.signals, self.turning))

    def along(self, windows: Windows) -> Chart:
        """The measured orientations at the windows' rows."""
        rows = torch.arange(windows.rows + 1, device=windows.first.device)
        begin = windows.value.new_tensor(windows.begin)[windows.run]
        instants = begin[:, None] + (windows.first[:, None] + rows) * windows.step
        B, shape = len(self.turning), instants.shape
        quaternion, turn = windows.value.new_zeros(*shape, B, 4), windows.value.new_zeros(*shape, B, 3)
        for r, run in enumerate(windows.runs):
            mine = windows.run == r
            for b, one in enumerate(self.paths[origin(run)]):
                q, turned = one.at(instants[mine].flatten())
                quaternion[mine, :, b] = q.unflatten(0, (-1, shape[1]))
                turn[mine, :, b] = turned.unflatten(0, (-1, shape[1]))
        return Chart(self.physics, self.turning, quaternion, turn)

    # --- a simulator --------------------------------------------------------------------------------------------

    @property
    def joint_kinds(self) -> Mapping[str, Literal["slide", "hinge"]]:
        """Those of the physics; the linear positions of free joints are slides."""
        linear: dict[str, Literal["slide", "hinge"]] = {name: "slide" for one in self.turning for name in one.linear}
        return {**self.physics.joint_kinds, **linear}

    def targets(self, kind: TargetKind) -> tuple[str, ...]:
        """Those of the physics without free and ball joints, and without the quaternions' parts."""
        out = {
            "joint": {name for one in self.turning for name in (*one.linear, *one.parts)},
            "signal": {name for one in self.turning for name in one.quaternion},
        }.get(kind, set())
        return tuple(name for name in self.physics.targets(kind) if name not in out)

    @property
    def state(self) -> TensorDict:
        """A copy of the complete state of all worlds, with turns."""
        return self._leave(self.physics.state)

    def reset(
        self, theta: Float[Tensor, "N P"], state: TensorDictBase | None = None, mask: Bool[Tensor, " N"] | None = None
    ) -> TensorDict:
        """See :meth:`Simulator.reset`."""
        return self._leave(self.physics.reset(theta, None if state is None else self._enter(state), mask))

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """See :meth:`Simulator.step`."""
        return self._leave(self.physics.step(inputs))

    def rollout(
        self,
        theta: Float[Tensor, "M P"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """See :meth:`Simulator.rollout`."""
        return self._leave(self.physics.rollout(theta, self._enter(state), inputs, times))

    def project_onto_constraints(self, state: TensorDictBase) -> TensorDictBase:
        """See :meth:`Identifiable.project_onto_constraints`."""
        there = self.physics.project_onto_constraints(self._enter(state)).clone(recurse=False)
        there["qpos"] = turns(self.turning, there["qpos"], *self._still(there["qpos"]))
        return there

    def constrained_positions(self, path: Float[Tensor, "T J"], known: Sequence[int]) -> Float[Tensor, "T J"]:
        """None: they are worked out of slides and hinges only."""
        return Identifiable.constrained_positions(self, path, known)

    def hidden_states_along(
        self, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
    ) -> dict[str, TensorDict]:
        """See :meth:`Identifiable.hidden_states_along`; they see scalar joints alone: any reference does for turns."""
        return self.physics.hidden_states_along(theta, self._enter(motion), step)

    def actuator_forces(
        self, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
    ) -> Float[Tensor, "N K U"]:
        """See :meth:`Identifiable.actuator_forces`; they depend on scalar joints alone."""
        return self.physics.actuator_forces(theta, self._enter(motion), step)

    def in_file(self, theta: Float[Tensor, " P"]) -> InFile | None:
        """See :meth:`Identifiable.in_file`."""
        return self.physics.in_file(theta)

    def read(self, state: TensorDictBase) -> Float[Tensor, "*batch S"]:
        """The turns of a state or trajectory, and what else the physics reads of it."""
        own = state.clone(recurse=False)
        own["qpos"] = own.pop(POSE)
        read = self.physics.read(own)[..., own["qpos"].shape[-1] :]
        return torch.cat([state["qpos"], read], dim=-1)

    def with_bounds(self, name: str, parameter: Parameter) -> Self:
        """See :meth:`Identifiable.with_bounds`."""
        return self.around(self.physics.with_bounds(name, parameter))

    def around(self, inner: Identifiable) -> Self:
        """The same paths around another simulator."""
        return type(self)(inner, self.paths)

    def _still(self, like: Tensor) -> tuple[Float[Tensor, "B 4"], Float[Tensor, "B 3"]]:
        B = len(self.turning)
        return like.new_tensor([1.0, 0.0, 0.0, 0.0]).expand(B, 4), like.new_zeros(B, 3)

    def _enter(self, state: TensorDictBase) -> TensorDictBase:
        state = state.clone(recurse=False)
        state["qpos"] = positions(self.turning, state["qpos"], *self._still(state["qpos"]))
        return state

    def _leave(self, state: TensorDict) -> TensorDict:
        state = state.clone(recurse=False)
        state[POSE] = state["qpos"]
        state["qpos"] = turns(self.turning, state[POSE], *self._still(state[POSE]))
        return state


def charted(simulator: Identifiable, measurement: Measurement) -> tuple[Identifiable, Measurement]:
    """The simulator and its measurement with turns in place of quaternions; themselves where all joints are scalar.

    Raises:
        BadInput: an orientation that was not measured, or is none.
    """
    turning = rotations(simulator.signals)
    if not turning:
        return simulator, measurement
    paths = {run: tuple(read_path(measurement, run, one) for one in turning) for run in measurement.runs}
    for b, one in enumerate(turning):
        measurement = unrolled(measurement, one, [paths[run][b] for run in measurement.runs])
    return ChartedSimulator(simulator, paths), measurement


def orientation_paths(
    simulator: Simulator,
) -> tuple[tuple[Rotation, ...], Mapping[str, tuple[OrientationPath, ...]]]:
    """The free and ball joints whose orientations became turns, and run -> the measured path of each."""
    while isinstance(simulator, SimulatorWrapper):
        if isinstance(simulator, ChartedSimulator):
            return simulator.turning, simulator.paths
        simulator = simulator.physics
    return (), {}


def with_orientation_paths(simulator: Identifiable, joint: str, paths: Mapping[str, OrientationPath]) -> Identifiable:
    """The simulator with other paths (run -> path) for one of its free and ball joints."""
    if not isinstance(simulator, ChartedSimulator):
        assert isinstance(simulator, SimulatorWrapper)
        return simulator.around(with_orientation_paths(simulator.physics, joint, paths))
    b = [one.joint for one in simulator.turning].index(joint)
    own = simulator.paths.items()
    return ChartedSimulator(simulator.physics, {run: (*c[:b], paths[run], *c[b + 1 :]) for run, c in own})


def chart_of(simulator: Identifiable, windows: Windows) -> Chart:
    """The chart of a simulator without scope along these windows."""
    if isinstance(simulator, ChartedSimulator):
        return simulator.along(windows)
    nothing = windows.value.new_zeros(windows.count, windows.rows + 1, 0, 4)
    return Chart(simulator, (), nothing, nothing[..., :3])
