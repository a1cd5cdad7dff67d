"""The effect interface: one named physical term with bounded parameters, which vanishes at its neutral value.

    tau_total = tau_model(q, v, u) + effect(q, v, u; parameters),      effect(...; neutral) = 0, bit for bit

An effect is written ``name@target``, e.g. ``dry_friction@carriage``; its parameters join the simulator's space as
``name@target.parameter``. It knows no engine. An engine gives it what it sees (:mod:`.seen`), and sizes from which it
takes its bounds (:mod:`.scales`):

| hook                            | law                                                                     |
|---------------------------------|-------------------------------------------------------------------------|
| ``force``, ``friction_bound``, ``inertia``, ``advance`` | force stage: a force, a dry friction's bound, hidden state |
| ``command``, ``rest``, ``trace`` | the input stage, with its hidden state                                 |
| ``sense``, ``unsense``          | what a sensor shows of the motion, and the state behind what it showed  |
| ``standalone``                  | the same in floats, for the Python file beside an exported model        |
| ``shift``                       | a parameter that changes in time: criticism replays each window so      |

Where an engine has a term of its own for an effect, that stands in the place of ``command`` and of the force stage (of
MuJoCo's see :mod:`onlinebayes.simulators.mujoco.native`). Some effects are such terms alone: their law needs what only
the engine knows, masses or contacts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar, Literal, Self

from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import ParameterSpace
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Reading, Seen
from onlinebayes.simulators.standalone.law import Law

TargetKind = Literal["joint", "actuator", "body", "geom", "site", "world", "signal", "parameter"]
"""The kind of element that an effect acts on; a world has one target, ``"world"``, a parameter's is its address."""


class Effect(ABC):
    """A named physical term at one target; subclasses are frozen dataclasses whose fields are target and Parameters.

    Attributes:
        name: the contract's name, e.g. ``"dry_friction"``.
        target_kind: what ``target`` names.
        wider: other kinds that it may name: the world for all bodies, a site for a place on one.
        tried_last: criticism tries it last, where nothing else explains the data (or where it is named).
        tried_at_servos: criticism tries it only at position servos and their joints (or where it is named).
        tried_where_lag_grows: criticism tries it only at signals whose lag grows along a run (or where it is named).
        tried_per_run: criticism tries it also with one size in every run.
        same_law_as: addresses of a model's own numbers that are the same law, ``*`` for the element, one for each axis
            where there are axes, e.g. ``joint.*.damping``.
        target: name of the joint, actuator, body, geom, site or signal, a parameter's address; ``"world"`` for all.
        has_command: whether the effect is an input stage (:meth:`command`).
        needs_drive: whether its force stage reads the actuators' force (``Seen.drive``).
        needs_servo: whether it reads the law of its actuator, of which its joint must have one (``Seen.servo``).
        needs_position: whether it depends on its joint's position, which must be measured then.
        contains: names of simpler effects that it becomes, at the same target, for some of its values.
        sum_of: names of effects at the same target that are, together, this one exactly.
        axes: the effect may act along one axis, ``target.axis``, and criticism tries each as a candidate of its own.
    """

    name: ClassVar[str]
    target_kind: ClassVar[TargetKind]
    wider: ClassVar[tuple[TargetKind, ...]] = ()
    tried_last: ClassVar[bool] = False
    tried_at_servos: ClassVar[bool] = False
    tried_where_lag_grows: ClassVar[bool] = False
    tried_per_run: ClassVar[bool] = False
    same_law_as: ClassVar[tuple[str, ...]] = ()
    target: str
    has_command: ClassVar[bool] = False
    needs_drive: ClassVar[bool] = False
    needs_servo: ClassVar[bool] = False
    needs_position: ClassVar[bool] = False
    contains: ClassVar[tuple[str, ...]] = ()
    sum_of: ClassVar[tuple[str, ...]] = ()
    axes: ClassVar[tuple[str, ...]] = ()

    @classmethod
    @abstractmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """The effect at ``target`` with physical bounds that suit these sizes (what ``diagnose`` tries)."""

    @property
    @abstractmethod
    def parameters(self) -> ParameterSpace:
        """The effect's own parameters, by their short names."""

    @property
    @abstractmethod
    def neutral(self) -> Mapping[str, float]:
        """The value of each parameter at which the effect is exactly nothing."""

    @property
    def key(self) -> str:
        """``name@target``."""
        return f"{self.name}@{self.target}"

    @property
    def magnitude(self) -> str:
        """Short name of the parameter that says how much of it there is, and is tested: the first one."""
        return self.parameters.names[0]

    @property
    def element(self) -> str:
        """Name of what the target stands for, without an axis."""
        return self.target

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Finite values from which screening also starts, for what is not small-signal linear; none by default."""
        return ()

    def said_by_joints(self, kinds: Mapping[str, str], moving: Sequence[str]) -> bool:
        """Check whether effects on single joints say the same with less; criticism then omits it. Never by default.

        Args:
            kinds: joint -> ``"slide"``, ``"hinge"``, or ``""`` where it is not known, of all joints.
            moving: joints that move the element, where it is a body.
        """
        return False

    @property
    def remembers(self) -> bool:
        """True if the effect has a hidden state."""
        return type(self).rest is not Effect.rest

    @property
    def memory(self) -> float:
        """The time for which past events act on through the hidden state [s]; 0 without one."""
        return 0.0

    # --- beside a model file ------------------------------------------------------------------------------------

    def standalone(self, values: Mapping[str, float]) -> Law | str:
        """The effect in one world as a law in floats alone, for a file beside MJCF that has no term for it.

        The source of the law's class goes into that file, its ``repr`` makes it there (see :mod:`..standalone`).

        Args:
            values: short name -> value [SI].

        Returns:
            The law; or why there is none, as a clause: "which ...".
        """
        return "which gives no law in plain Python (Effect.standalone)"

    # --- the force stage ----------------------------------------------------------------------------------------

    @property
    def has_force(self) -> bool:
        """True if the effect has a force stage."""
        return type(self).force is not Effect.force or self.bounds_friction or self.changes_inertia

    @property
    def bounds_friction(self) -> bool:
        """True if its force stage bounds a dry friction."""
        return type(self).friction_bound is not Effect.friction_bound

    @property
    def changes_inertia(self) -> bool:
        """True if its force stage changes the joint's inertia."""
        return type(self).inertia is not Effect.inertia

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"] | None:
        """Return the force added to the target joint's generalised force, or to that of the target actuator [N, N m].

        It is held over a timestep, evaluated at its start, or in its middle where MuJoCo goes by Runge and Kutta's
        method and the effect has no hidden state; None where the effect has none.
        """
        return None

    def friction_bound(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"] | None:
        """Bound F >= 0 of a Coulomb force on the target joint [N, N m], which the solver makes stick, or None."""
        return None

    def inertia(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"] | None:
        """Return the inertia added to that of the target joint over the step [kg, kg m2], or None."""
        return None

    def advance(self, parameters: Mapping[str, Tensor], seen: Seen) -> TensorDict | None:
        """The hidden state after the step; it stays by default."""
        return seen.hidden

    def along(self, parameters: Mapping[str, Tensor], seen: Seen) -> TensorDict | None:
        """The hidden state after each of K rows of a known motion, batch size (N, K).

        Args:
            parameters: short name -> values (N,).
            seen: what :meth:`advance` would see row by row, (N, K); its hidden state is that before the first row.

        An effect whose states are at hand all together says so; by default the rows are walked through one by one.
        """
        states, hidden = [], seen.hidden
        for k in range(seen.q.shape[1]):
            hidden = self.advance(parameters, seen.row(k, hidden))
            states.append(hidden)
        return None if hidden is None else TensorDict.stack(states, dim=1)

    # --- sensors ------------------------------------------------------------------------------------------------

    def sense(self, parameters: Mapping[str, Tensor], reading: Reading) -> Float[Tensor, "*batch T"]:
        """Return the values of the target signal that the sensor shows; parameters have shape (*batch,) [SI]."""
        return reading.value

    def unsense(
        self, parameters: Mapping[str, Tensor], q: Float[Tensor, "*batch"], v: Float[Tensor, "*batch"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
        """The joint's position and velocity behind those that the sensor of its position shows."""
        return q, v

    # --- parameters in time -------------------------------------------------------------------------------------

    @property
    def shifted(self) -> str:
        """Address of the parameter that :meth:`shift` moves: the target, where that is one; empty where none is."""
        return self.target if self.target_kind == "parameter" else ""

    def shift(
        self, parameters: Mapping[str, Tensor], begin: Float[Tensor, " W"], end: Float[Tensor, " W"]
    ) -> Float[Tensor, "*batch W"] | None:
        """By how much the parameter that is :attr:`shifted` differs from its fitted value between two instants.

        On average, where it is the target and held in between; at the first of them, where it is the effect's own and
        the trajectory begins there.

        Args:
            parameters: short name -> values (*batch, W).
            begin, end: instants on the measurements' clock [s].
        """
        return None

    # --- hidden state and input stage ---------------------------------------------------------------------------

    def rest(self, worlds: int, timestep: float, like: Tensor) -> TensorDict | None:
        """The hidden state before anything has happened, batch size (worlds,), or None for an effect without one."""
        return None

    def command(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> tuple[Float[Tensor, "N K"], TensorDict | None]:
        """Return the target actuator's input over K consecutive timesteps, and the hidden state after them.

        Args:
            parameters: short name -> values (N,).
            state: the hidden state before the first of the K steps (see :meth:`rest`).
            command: the command on each timestep [command units].
            timestep: length of one [s].
        """
        return command, state

    def trace(
        self,
        parameters: Mapping[str, Tensor],
        state: TensorDict | None,
        command: Float[Tensor, "N K"],
        timestep: float,
    ) -> TensorDict | None:
        """The hidden state after each of the K timesteps, batch size (N, K): what :meth:`command` would leave there.

        A stage whose states are at hand all together says so; by default they are walked through one by one.
        """
        if state is None:
            return None
        states: list[TensorDict] = []
        for k in range(command.shape[1]):
            _, after = self.command(parameters, states[-1] if k else state, command[:, k : k + 1], timestep)
            if after is None:
                return None
            states.append(after)
        return TensorDict.stack(states, dim=1)


def split_axis(target: str, axes: tuple[str, ...]) -> tuple[str, str]:
    """The element and the axis of ``element.axis``; the axis is empty where the target names none."""
    element, dot, axis = target.rpartition(".")
    return (element, axis) if dot and axis in axes else (target, "")
