"""What identification and criticism ask of a simulator besides stepping it; all but signals has a default.

| ability                               | members                                                                     |
|---------------------------------------|-----------------------------------------------------------------------------|
| what it measures, and is commanded by | ``signals``, ``read``, ``commands``, ``effects``                            |
| what effects can act on               | ``targets``, ``joint_kinds``, ``body_sizes``, ``contacts``, ...             |
| how it integrates                     | ``timestep``, ``with_timestep``, ``with_runge_kutta``, ``with_first_order`` |
| what commands leave behind            | ``memory_span``, ``hidden_states_along``, ``command_driven_states``, ...    |
| constraints between joints            | ``project_onto_constraints``, ``constrained_positions``, ...                |
| the same system, a little different   | ``with_bounds``, ``with_free``, ``with_payload``, ...                       |
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal, Self

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator

if TYPE_CHECKING:
    from onlinebayes.simulators.effects import Contact, Effect, TargetKind


class Identifiable(Simulator):
    """A simulator that a log can be replayed through, and whose parameters a log can tell.

    Attributes:
        timestep: seconds of one integration step [s]; ``dt`` is a whole number of them.
        commands: names of the U command columns, e.g. ``("motor",)``.
        signals: names of the S signals that :meth:`read` gives, e.g. ``("qpos.hinge", "qvel.hinge")``.
        effects: the effects added so far, in order.
    """

    timestep: float
    commands: tuple[str, ...]
    signals: tuple[str, ...]
    effects: tuple[Effect, ...]

    @property
    def joint_kinds(self) -> Mapping[str, Literal["slide", "hinge"]]:
        """Kind of each slide and hinge joint, which decides units; joints that it lacks are taken for hinges."""
        return {}

    def targets(self, kind: TargetKind) -> tuple[str, ...]:
        """What effects of one kind can act on, by name; bodies, geoms, the world only where a backend has them."""
        if kind == "actuator":
            return self.commands
        if kind == "signal":
            return self.signals
        if kind == "parameter":
            return tuple(name for name in self.parameters if "@" not in name)
        names = (name.removeprefix("qpos.") for name in self.signals if name.startswith("qpos."))
        return tuple(names) if kind == "joint" else ()

    @property
    def own_effects(self) -> Mapping[str, type[Effect]]:
        """Effects that the system's own equations hold (tyres, fluids), by name, besides the general vocabulary."""
        return {}

    @property
    def body_sizes(self) -> Mapping[str, tuple[float, float]]:
        """Mass [kg] and size [m] of each of the bodies among :meth:`targets`, as the system was built."""
        return {}

    @property
    def moving_joints(self) -> Mapping[str, tuple[str, ...]]:
        """Joints that move each of the bodies among :meth:`targets`; without those of which that is not known."""
        return {}

    @property
    def servos(self) -> tuple[str, ...]:
        """Joints of which an actuator holds a position; none by default."""
        return ()

    @property
    def contacts(self) -> Mapping[str, Contact]:
        """What the contacts of each of the geoms and bodies among :meth:`targets` of geoms are like, as built."""
        return {}

    @property
    def fed_by_command(self) -> frozenset[str]:
        """Keys of :attr:`state`, effects aside, that follow from commands and theta whatever moves; none by default."""
        return frozenset()

    def project_onto_constraints(self, state: TensorDictBase) -> TensorDictBase:
        """The nearest states that the system's constraints between joints allow; all states by default."""
        return state

    def with_rigid_constraints(self) -> Self:
        """A new simulator whose constraints between joints are rigid where nobody said how soft they are; or itself."""
        return self

    def constrained_positions(self, path: Float[Tensor, "T J"], known: Sequence[int]) -> Float[Tensor, "T J"]:
        """Positions along a path of the joints that were measured, the others as constraints tie them to these.

        Args:
            path: of all joints; what is not known is overwritten [m, rad].
            known: places of those that were measured.

        Returns:
            The path, nan where nothing ties a joint; by default all that is not known.
        """
        found = torch.full_like(path, torch.nan)
        found[:, list(known)] = path[:, list(known)]
        return found

    def hidden_states_along(
        self, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
    ) -> dict[str, TensorDict]:
        """Hidden states of effects that follow from a known motion alone, no physics simulated.

        Args:
            theta: parameters of each world [SI].
            motion: batch size (N, K): ``"qpos"`` and ``"qvel"`` in the middle of each row, ``"command"`` and,
                optionally, ``"enable"`` that hold during it. Before the first row commands were what they are in it,
                and the hidden states of force stages at rest.
            step: length of a row [s].

        Returns:
            Key of the effect -> its hidden state before the first row and after each, batch size (N, K + 1); none by
            default, and then criticism replays what came before a window.
        """
        return {}

    def command_driven_states(
        self, theta: Float[Tensor, "N P"], command: Float[Tensor, "N K U"], step: float
    ) -> dict[str, Float[Tensor, "N K1 n"]]:
        """Parts of the state that follow from commands alone (MuJoCo: ``act``), no physics simulated.

        Args:
            theta: parameters of each world [SI].
            command: held during each row [command units]; before the first row it was what it is in it, and what
                settles had settled.
            step: length of a row [s].

        Returns:
            Key of the state -> its value before the first row and after each, N worlds x (K + 1) rows x n; none by
            default, and then criticism replays what came before a window.
        """
        return {}

    @property
    def memory_span(self) -> float:
        """Time [s] after which nothing is left of the states' beginning in :meth:`command_driven_states`; 0 by default.

        Windows do not begin earlier than that in a run: what was commanded before the log is not in it.
        """
        return 0.0

    @property
    def integrating_commands(self) -> tuple[str, ...]:
        """Commands that the state remembers for ever (integrators), how it began included; none by default."""
        return ()

    def actuator_forces(
        self, theta: Float[Tensor, "N P"], motion: TensorDictBase, step: float
    ) -> Float[Tensor, "N K U"]:
        """Force of each actuator before its gear along a known motion [N, N m]; by default its command.

        Args:
            theta, motion, step: as for :meth:`hidden_states_along`.
        """
        return motion.get("command").to(theta)

    @abstractmethod
    def read(self, state: TensorDictBase) -> Float[Tensor, "*batch S"]:
        """The signals of a state or trajectory, in the order of :attr:`signals`."""

    @property
    def own_numbers(self) -> Mapping[str, Parameter]:
        """Addresses of the model's own numbers that may be off -> how far; none by default."""
        return {}

    def with_free(self, name: str, parameter: Parameter) -> Self:
        """A new simulator one more of whose :attr:`own_numbers` is a parameter; all worlds nominal.

        Raises:
            BadInput: there is no such number, or it is free already.
        """
        raise BadInput(f"{type(self).__name__} has no number '{name}' to free", "override own_numbers and with_free")

    def with_bounds(self, name: str, parameter: Parameter) -> Self:
        """A new simulator whose free parameter ``name`` has other bounds; all worlds nominal.

        Raises:
            BadInput: there is no such parameter, or this simulator's bounds are fixed.
        """
        raise BadInput(f"the bounds of {type(self).__name__} are fixed", "override with_bounds to let them be judged")

    def with_timestep(self, timestep: float) -> Self:
        """A new simulator that integrates with this step [s] and whose ``dt`` is one of them; all worlds nominal.

        Raises:
            BadInput: this simulator's step cannot be changed.
        """
        raise BadInput(
            f"{type(self).__name__} integrates with a step of {self.timestep:g} s only",
            "override with_timestep to let numerics be checked",
        )

    def with_runge_kutta(self) -> Self:
        """The same system integrated by Runge and Kutta's method of fourth order; itself where it is already.

        Raises:
            BadInput: this simulator has one integrator only.
        """
        raise BadInput(
            f"{type(self).__name__} has one integrator only",
            "override with_runge_kutta to let numerics be checked at coarse steps",
        )

    def with_first_order(self) -> Self:
        """The same system, steps and all, by a method of first order that evaluates its forces once a step.

        For what needs many replays and few digits. Itself where it is integrated so already, or by one method only.
        """
        return self

    def with_soft_friction(self) -> Self:
        """The same system with the engine's own soft dry friction where effects made it stick; itself without such."""
        return self

    def with_scaled_moments(self) -> Self:
        """The same system, moments of inertia in proportion to the free masses; itself where that changes nothing."""
        return self

    def with_gravity_compensation(self) -> Identifiable | None:
        """The same system with its weight carried by its drives; None where that is not possible or changes nothing."""
        return None

    def with_payload(self, body: str, mass: float) -> Self:
        """A new simulator with a known point mass [kg] at a body's centre of mass, besides what its parameters say.

        Raises:
            BadInput: no such body, or this simulator has none.
        """
        raise BadInput(f"{type(self).__name__} has no bodies to fix {mass:g} kg to", "leave the payload out")
