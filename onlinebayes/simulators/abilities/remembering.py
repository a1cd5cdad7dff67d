"""The memory of motion and commands in a simulator's state, computed without its physics."""

from __future__ import annotations

from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.simulators.base import Simulator


class Remembering(Simulator):
    """A simulator that says what a known past leaves in its state; by default it says nothing.

    Criticism then replays what came before a window.
    """

    @property
    def fed_by_command(self) -> frozenset[str]:
        """Keys of :attr:`state`, effects aside, that follow from commands and theta whatever moves; none by default."""
        return frozenset()

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
