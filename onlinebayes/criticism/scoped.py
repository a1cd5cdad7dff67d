"""A simulator whose parameters differ between runs: fitted as one vector phi, replayed with each window's own theta.

    theta_w = A_r(w) phi + c_r(w)          (see :mod:`.scope`)

It is itself a simulator, of the **typical** world: own values at their mean, known constants at the model's own. Fits,
scores and reports see phi and its bounds; only the replay of windows asks for every window's theta (:func:`unfold`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, Self

import torch
from jaxtyping import Bool, Float, Int
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.criticism.scope import Scope, address_of, own_name
from onlinebayes.criticism.split import origin
from onlinebayes.criticism.timed import in_time
from onlinebayes.criticism.windows import Windows
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import Contact, Effect, TargetKind


class ScopedSimulator(Simulator):
    """The worlds of ``physics``, some of whose parameters depend on the run.

    Args:
        physics: the simulator that is replayed.
        scope: what differs between runs.
        runs: the runs that are fitted, each of which gets own values.

    Attributes:
        parameters: of phi.
    """

    def __init__(self, physics: Simulator, scope: Scope, runs: Sequence[str]) -> None:
        self.physics, self.scope, self.runs = physics, scope, tuple(runs)
        entries: dict[str, tuple[int, int, Parameter]] = {}  # name -> (place in theta, run or -1, bounds)
        constants = {run: scope.constants(run) for run in self.runs}
        for i, (address, bounds) in enumerate(physics.parameters.items()):
            unknown = [r for r, run in enumerate(self.runs) if address not in constants[run]]
            if address in scope.unfitted or not unknown:
                continue
            if scope.owned(address):
                entries |= {own_name(address, self.runs[r]): (i, r, bounds) for r in unknown}
            else:
                entries[address] = (i, -1, bounds)
        self.parameters = ParameterSpace({name: bounds for name, (_, _, bounds) in entries.items()})
        self.place: Int[Tensor, " F"] = torch.tensor([i for i, _, _ in entries.values()], dtype=torch.long)
        self.own: Int[Tensor, " F"] = torch.tensor([r for _, r, _ in entries.values()], dtype=torch.long)
        self.worlds, self.dt, self.timestep = physics.worlds, physics.dt, physics.timestep
        self.commands, self.signals, self.effects = physics.commands, physics.signals, physics.effects
        self.device, self.dtype = physics.device, physics.dtype
        self._phi = self.nominal.expand(self.worlds, -1).clone()

    # --- the map ------------------------------------------------------------------------------------------------

    def affine(self, run: str | None) -> tuple[Float[Tensor, "P F"], Float[Tensor, " P"]]:
        """(A, c) of one run, or of the typical world."""
        space, nominal = self.physics.parameters, self.physics.nominal.to(torch.float64)
        known = {} if run is None else self.scope.constants(run)
        A, c = torch.zeros(len(space), len(self.parameters), dtype=torch.float64), torch.zeros_like(nominal)
        for i, address in enumerate(space):
            columns = (self.place == i).nonzero()[:, 0].tolist()
            if address in known:
                c[i] = known[address]
            elif not columns:
                c[i] = nominal[i]
            else:
                mine = [f for f in columns if self._belongs(f, run)]
                A[i, mine or columns] = 1 / len(mine or columns)
        return A, c

    def typical(self, phi: Float[Tensor, "*batch F"]) -> Float[Tensor, "*batch P"]:
        """Theta of the typical world."""
        A, c = (x.to(phi) for x in self.affine(None))
        return phi @ A.T + c

    def of_windows(self, phi: Float[Tensor, "M F"], windows: Windows) -> Float[Tensor, "M W P"]:
        """Theta of every window."""
        theta = torch.stack([phi @ A.to(phi).T + c.to(phi) for A, c in map(self.affine, windows.runs)], dim=1)
        return theta[:, windows.run]

    def touches(self, windows: Windows) -> Bool[Tensor, "F W"]:
        """Which windows each entry of phi can move."""
        A = torch.stack([self.affine(run)[0] for run in windows.runs])
        return (A != 0).any(1)[windows.run].T

    def free_in(self, run: str) -> tuple[str, ...]:
        """Addresses of which a run has a value of its own that is neither known nor fitted yet."""
        known = {*self.scope.constants(run), *self.scope.unfitted}
        return tuple(
            name
            for name in self.physics.parameters
            if self.scope.owned(name) and name not in known and own_name(name, origin(run)) not in self.parameters
        )

    def _belongs(self, entry: int, run: str | None) -> bool:
        r = int(self.own[entry])
        return r < 0 or (run is not None and self.runs[r] in (run, origin(run)))

    # --- a simulator --------------------------------------------------------------------------------------------

    @property
    def joint_kinds(self) -> Mapping[str, Literal["slide", "hinge"]]:
        """Those of the physics."""
        return self.physics.joint_kinds

    def targets(self, kind: TargetKind) -> tuple[str, ...]:
        """Those of the physics; of the parameters those that are fitted."""
        found = self.physics.targets(kind)
        return tuple(name for name in found if kind != "parameter" or name not in self.scope.unfitted)

    @property
    def body_sizes(self) -> Mapping[str, tuple[float, float]]:
        """Those of the physics."""
        return self.physics.body_sizes

    @property
    def contacts(self) -> Mapping[str, Contact]:
        """Those of the physics."""
        return self.physics.contacts

    @property
    def actuator_gains(self) -> Mapping[str, float]:
        """Those of the physics."""
        return self.physics.actuator_gains

    @property
    def nominal(self) -> Float[Tensor, " F"]:
        """The physics' own value for every entry of phi."""
        return self.physics.nominal[self.place]

    @property
    def state(self) -> TensorDict:
        """A copy of the complete state of all worlds."""
        return self.physics.state

    @property
    def theta(self) -> Float[Tensor, "N F"]:
        """A copy of every typical world's phi."""
        return self._phi.clone()

    @property
    def failed(self) -> Bool[Tensor, " N"]:
        """Worlds that diverged since their last reset."""
        return self.physics.failed

    def reset(
        self, theta: Float[Tensor, "N F"], state: TensorDictBase | None = None, mask: Bool[Tensor, " N"] | None = None
    ) -> TensorDict:
        """Typical worlds; see :meth:`Simulator.reset`."""
        rows = slice(None) if mask is None else mask
        self._phi[rows] = theta[rows].to(self._phi)
        return self.physics.reset(self.typical(self._phi), state, mask)

    def step(self, inputs: TensorDictBase) -> TensorDict:
        """See :meth:`Simulator.step`."""
        return self.physics.step(inputs)

    def rollout(
        self,
        theta: Float[Tensor, "M F"],
        state: TensorDictBase,
        inputs: TensorDictBase,
        times: Float[Tensor, " T"],
    ) -> TensorDict:
        """Typical worlds; see :meth:`Simulator.rollout`."""
        return self.physics.rollout(self.typical(theta), state, inputs, times)

    def read(self, state: TensorDictBase) -> Float[Tensor, "*batch S"]:
        """See :meth:`Simulator.read`."""
        return self.physics.read(state)

    def with_effect(self, effect: Effect) -> Self:
        """The effect's parameters follow the present entries of phi, one a run where the scope says so."""
        return self._around(self.physics.with_effect(effect))

    def with_worlds(self, worlds: int) -> Self:
        """See :meth:`Simulator.with_worlds`."""
        return self._around(self.physics.with_worlds(worlds))

    def with_bounds(self, name: str, parameter: Parameter) -> Self:
        """Other bounds for one address, in every run that has a value of its own; see :meth:`Simulator.with_bounds`."""
        return self._around(self.physics.with_bounds(address_of(name), parameter))

    def with_timestep(self, timestep: float) -> Self:
        """See :meth:`Simulator.with_timestep`."""
        return self._around(self.physics.with_timestep(timestep))

    def with_runge_kutta(self) -> Self:
        """See :meth:`Simulator.with_runge_kutta`."""
        other = self.physics.with_runge_kutta()
        return self if other is self.physics else self._around(other)

    def with_gravity_compensation(self) -> Simulator | None:
        """See :meth:`Simulator.with_gravity_compensation`."""
        other = self.physics.with_gravity_compensation()
        return None if other is None else self._around(other)

    def with_payload(self, body: str, mass: float) -> Self:
        """See :meth:`Simulator.with_payload`."""
        return self._around(self.physics.with_payload(body, mass))

    def _around(self, physics: Simulator) -> Self:
        return type(self)(physics, self.scope, self.runs)


def scoped(simulator: Simulator, scope: Scope | None, measurement: Measurement, runs: Sequence[str]) -> Simulator:
    """The simulator with this scope; itself without one.

    Args:
        simulator: with every address of the scope among its parameters.
        scope: what differs between runs, or None.
        measurement: all runs, for the names that the scope may use.
        runs: the ones that are fitted.

    Raises:
        BadInput: the scope names a run or a parameter that is not there.
    """
    if not scope:
        return simulator
    scope.check(simulator.parameters, measurement.runs)
    return ScopedSimulator(simulator, scope, runs)


def physics(simulator: Simulator) -> Simulator:
    """The simulator without its scope."""
    return simulator.physics if isinstance(simulator, ScopedSimulator) else simulator


def physical(simulator: Simulator, theta: Float[Tensor, " F"]) -> Float[Tensor, " P"]:
    """What :func:`physics` of this simulator gets in the typical world."""
    return simulator.typical(theta) if isinstance(simulator, ScopedSimulator) else theta


def unfold(
    simulator: Simulator, windows: Windows, theta: Float[Tensor, "M F"]
) -> tuple[Simulator, Float[Tensor, "M W P"]]:
    """What is replayed, and every window's theta."""
    if isinstance(simulator, ScopedSimulator):
        return simulator.physics, in_time(simulator.physics, windows, simulator.of_windows(theta, windows))
    return simulator, in_time(simulator, windows, theta[:, None].expand(len(theta), windows.count, theta.shape[1]))


def effect_entries(simulator: Simulator, effect: Effect) -> dict[str, str]:
    """Entries that an effect has, or would have, in the simulator's parameters -> its short names, in their order."""
    if not isinstance(simulator, ScopedSimulator):
        return {f"{effect.key}.{name}": name for name in effect.parameters}
    found: dict[str, str] = {}
    constants = {run: simulator.scope.constants(run) for run in simulator.runs}
    for name in effect.parameters:
        address = f"{effect.key}.{name}"
        unknown = [run for run in simulator.runs if address not in constants[run]]
        if address in simulator.scope.unfitted or not unknown:
            continue
        entries = [own_name(address, run) for run in unknown] if simulator.scope.owned(address) else [address]
        found |= dict.fromkeys(entries, name)
    return found
