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

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.replaying.timed import Rows, in_time
from onlinebayes.identification.replaying.wrapper import SimulatorWrapper
from onlinebayes.identification.scope import Scope, address_of
from onlinebayes.identification.splitting import origin
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.abilities import InFile
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import Effect, TargetKind
from onlinebayes.simulators.identifiable import Identifiable


class ScopedSimulator(SimulatorWrapper):
    """The worlds of ``physics``, some of whose parameters depend on the run.

    Args:
        physics: the simulator that is replayed.
        scope: what differs between runs.
        runs: the runs that are fitted, each of which (or each group or unit of which) gets own values.

    Attributes:
        parameters: of phi.
        owners: the runs, groups and units that have own values.
        place, own: which of the physics' parameters each entry of phi is, and its number among the owners (-1: shared).
    """

    def __init__(self, physics: Identifiable, scope: Scope, runs: Sequence[str]) -> None:
        super().__init__(physics)
        self.scope, self.runs = scope, tuple(runs)
        owned = tuple(filter(scope.owned, physics.parameters))
        self.owners = tuple(dict.fromkeys(scope.owner(address, run) for run in self.runs for address in owned))
        entries: dict[str, tuple[int, int, Parameter]] = {}  # name -> (place in theta, owner or -1, bounds)
        for i, (address, bounds) in enumerate(physics.parameters.items()):
            unknown = scope.owners_without(address, self.runs)
            if address in scope.unfitted or not unknown:
                continue
            if scope.owned(address):
                entries |= {scope.entry(address, owner): (i, self.owners.index(owner), bounds) for owner in unknown}
            else:
                entries[address] = (i, -1, bounds)
        self.parameters = ParameterSpace({name: bounds for name, (_, _, bounds) in entries.items()})
        place, own = [i for i, _, _ in entries.values()], [r for _, r, _ in entries.values()]
        self.place: Int[Tensor, " F"] = torch.tensor(place, dtype=torch.long, device=self.device)
        self.own: Int[Tensor, " F"] = torch.tensor(own, dtype=torch.long, device=self.device)
        self.signals = physics.signals
        self._phi = self.nominal.expand(self.worlds, -1).clone()

    # --- the map ------------------------------------------------------------------------------------------------

    def affine(self, run: str | None) -> tuple[Float[Tensor, "P F"], Float[Tensor, " P"]]:
        """(A, c) of one run, or of the typical world."""
        space, nominal = self.physics.parameters, self.physics.nominal.to(torch.float64)
        known = {} if run is None else self.scope.constants(run)
        A, c = nominal.new_zeros(len(space), len(self.parameters)), torch.zeros_like(nominal)
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
        """Return a mask of the windows that each entry of phi can move."""
        A = torch.stack([self.affine(run)[0] for run in windows.runs])
        return (A != 0).any(1).to(windows.run.device)[windows.run].T

    def free_in(self, run: str) -> tuple[str, ...]:
        """Addresses of which a run has a value of its own that is neither known nor fitted yet."""
        scope, known = self.scope, {*self.scope.constants(run), *self.scope.unfitted}
        return tuple(
            name
            for name in self.physics.parameters
            if scope.owned(name)
            and name not in known
            and scope.entry(name, scope.owner(name, origin(run))) not in self.parameters
        )

    def _belongs(self, entry: int, run: str | None) -> bool:
        r, address = int(self.own[entry]), self.physics.parameters.names[int(self.place[entry])]
        return r < 0 or (
            run is not None and self.owners[r] in {self.scope.owner(address, one) for one in (run, origin(run))}
        )

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

    def reset(
        self, theta: Float[Tensor, "N F"], state: TensorDictBase | None = None, mask: Bool[Tensor, " N"] | None = None
    ) -> TensorDict:
        """Typical worlds; see :meth:`Simulator.reset`."""
        rows = slice(None) if mask is None else mask.to(self._phi.device)
        self._phi[rows] = theta.to(self._phi)[rows]
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

    def hidden_states_along(
        self, theta: Float[Tensor, "N F"], motion: TensorDictBase, step: float
    ) -> dict[str, TensorDict]:
        """Typical worlds; see :meth:`Identifiable.hidden_states_along`."""
        return self.physics.hidden_states_along(self.typical(theta), motion, step)

    def command_driven_states(
        self, theta: Float[Tensor, "N F"], command: Float[Tensor, "N K U"], step: float
    ) -> dict[str, Float[Tensor, "N K1 n"]]:
        """Typical worlds; see :meth:`Identifiable.command_driven_states`."""
        return self.physics.command_driven_states(self.typical(theta), command, step)

    def actuator_forces(
        self, theta: Float[Tensor, "N F"], motion: TensorDictBase, step: float
    ) -> Float[Tensor, "N K U"]:
        """Of typical worlds; see :meth:`Identifiable.actuator_forces`."""
        return self.physics.actuator_forces(self.typical(theta), motion, step)

    def in_file(self, theta: Float[Tensor, " F"]) -> InFile | None:
        """Of the typical world; see :meth:`Identifiable.in_file`."""
        return self.physics.in_file(self.typical(theta))

    def read(self, state: TensorDictBase) -> Float[Tensor, "*batch S"]:
        """See :meth:`Identifiable.read`."""
        return self.physics.read(state)

    def with_bounds(self, name: str, parameter: Parameter) -> Self:
        """Other bounds for one address, in every run with a value of its own; see :meth:`Identifiable.with_bounds`."""
        return self.around(self.physics.with_bounds(address_of(name), parameter))

    def around(self, inner: Identifiable) -> Self:
        """The same scope; an effect's parameters follow the present entries of phi, one a run where it says so."""
        return type(self)(inner, self.scope, self.runs)


def scoped(simulator: Identifiable, scope: Scope | None, measurement: Measurement, runs: Sequence[str]) -> Identifiable:
    """The simulator with this scope; itself without one.

    Args:
        simulator: with every address of the scope among its parameters.
        scope: what differs between runs, or None.
        measurement: all runs, for the names that the scope may use.
        runs: the ones that are fitted.

    Raises:
        BadInput: the scope names a run or a parameter that is not there, or the fitted runs are of one unit alone.
    """
    if not scope:
        return simulator
    scope.check(simulator.parameters, measurement.runs)
    scope.check_units(runs)
    return ScopedSimulator(simulator, scope, runs)


def unscoped(simulator: Identifiable) -> Identifiable:
    """The simulator without its scope."""
    return simulator.physics if isinstance(simulator, ScopedSimulator) else simulator


def physical(simulator: Simulator, theta: Float[Tensor, " F"]) -> Float[Tensor, " P"]:
    """Return the theta that :func:`.wrapper.unwrap` of this simulator gets in the typical world."""
    return simulator.typical(theta) if isinstance(simulator, ScopedSimulator) else theta


def in_run(simulator: Simulator, theta: Float[Tensor, " F"], run: str) -> Float[Tensor, " P"]:
    """Return the theta that :func:`.wrapper.unwrap` of this simulator gets in a run; the typical one if it has none."""
    if not isinstance(simulator, ScopedSimulator):
        return theta
    A, c = (x.to(theta) for x in simulator.affine(run))
    return A @ theta + c


def unfold(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, "M F"], rows: Rows | None = None
) -> tuple[Identifiable, Float[Tensor, "M W P"]]:
    """Return the simulator to replay and each window's theta: over all of it, or a piece's rows (see :mod:`.timed`)."""
    if isinstance(simulator, ScopedSimulator):
        return simulator.physics, in_time(simulator.physics, windows, simulator.of_windows(theta, windows), rows)
    everywhere = theta[:, None].expand(len(theta), windows.count, theta.shape[1])
    return simulator, in_time(simulator, windows, everywhere, rows)


def effect_entries(simulator: Simulator, effect: Effect) -> dict[str, str]:
    """Entries that an effect has, or would have, in the simulator's parameters -> its short names, in their order."""
    if not isinstance(simulator, ScopedSimulator):
        return {f"{effect.key}.{name}": name for name in effect.parameters}
    found: dict[str, str] = {}
    for name in effect.parameters:
        address = f"{effect.key}.{name}"
        unknown = simulator.scope.owners_without(address, simulator.runs)
        if address in simulator.scope.unfitted or not unknown:
            continue
        scope = simulator.scope
        entries = [scope.entry(address, owner) for owner in unknown] if scope.owned(address) else [address]
        found |= dict.fromkeys(entries, name)
    return found
