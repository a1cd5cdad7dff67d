"""One step of a rig: classical Runge-Kutta on the moving joints, true stick on the resting ones.

    M(q) a = f + tau - c - s F                 moving joints, s = sign(v)
    a_i = 0,  |load_i| <= F_i                  stuck joints: velocity exactly zero

A joint at rest is stuck while the load that the others put on it stays below its friction; the stuck set is found by
releasing those that are overloaded, until none is. A joint whose velocity changes sign within a step is stopped at that
instant, found by interpolation, by an impulse of its own friction (the others feel it through M); the rest of the step
begins with it at rest.

Hidden behind a joint there may be one more mass, tied to it by a spring with free play:

    m_x a_x = -k dz(x - q) - c (v_x - v)  (+ the actuator, when it drives the mass),   dz: zero within the play

What is private here runs in the innermost loop on arrays (R, N), N = n and the hidden mass; checks of their shapes
would cost the tests more than the mechanics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from envs.rigs.drive import Drive
from envs.rigs.equations import Equations
from envs.rigs.laws import CompiledLaws

TURNS = 2  # of joints within one step that are placed in time; a third stops at the step's end
CLOSE = 0.05  # of the velocity before the step: what is left of it at an instant that was interpolated
TINY = 1e-12


@final
@dataclass(frozen=True)
class HiddenMass:
    """A mass behind a joint.

    Args:
        joint: index of the joint.
        mass: m_x [kg, kg m2].
        stiffness, damping: k, c [SI]; the damper acts only outside the play.
        gap: full width of the play [m, rad].
        driven: whether the actuator drives the mass, which is then a part of the joint's inertia (backlash), or the
            joint (flexible mode).
    """

    joint: int
    mass: float
    stiffness: float
    damping: float
    gap: float
    driven: bool


@final
@dataclass(frozen=True)
class Hysteresis:
    """A force -A z with a memory, dz/dt = (v - |v| z) / width: outside the vocabulary.

    Args:
        joint: index of the joint.
        amplitude: A [N, N m].
        width: of the loop [m, rad].
    """

    joint: int
    amplitude: float
    width: float


@final
class Plant:
    """A rig in motion; it holds the states of R runs.

    Args:
        equations: of the n joints.
        laws: at the joints.
        drive: the actuators.
        q, v: where the runs start [SI].
        mass: what hides behind a joint, or None.
        hysteresis: a force with memory, or None.
    """

    def __init__(
        self,
        equations: Equations,
        laws: CompiledLaws,
        drive: Drive,
        q: Float[ndarray, "R n"],
        v: Float[ndarray, "R n"],
        mass: HiddenMass | None = None,
        hysteresis: Hysteresis | None = None,
    ) -> None:
        self.equations, self.laws, self.drive, self.time = equations, laws, drive, 0.0
        self.mass, self.hysteresis = mass, hysteresis
        self.joints, self._memory = q.shape[1], np.zeros(len(q))
        behind = [mass.joint] if mass else []
        self._q, self._v = (np.concatenate([x, x[:, behind]], 1) for x in (q, v))

    @property
    def q(self) -> Float[ndarray, "R n"]:
        """Positions of the joints [m, rad]."""
        return self._q[:, : self.joints]

    @property
    def v(self) -> Float[ndarray, "R n"]:
        """Velocities of the joints [m/s, rad/s]."""
        return self._v[:, : self.joints]

    def advance(self, command: Float[ndarray, "R m"]) -> None:
        """One step of the drive's h under a held command."""
        u, left = self.drive.shaped(command), np.full((len(self._q), 1), self.drive.step)
        q, v, sign = self._stepped(u, left)
        for _ in range(TURNS):
            part = self._until_a_turn(v, sign, u)
            if bool((part == 1).all()):
                break
            self._q, v, sign = self._stepped(u, part * left)
            # What interpolation leaves of the velocity counts as turned, so that it is stopped here.
            near = (np.abs(v) <= CLOSE * np.abs(self._v)) & (part < 1)
            self._v, left = self._stopped(np.where(near, -sign * TINY, v), sign, u), (1 - part) * left
            q, v, sign = self._stepped(u, left)
        self._q, self._v = q, self._stopped(v, sign, u) if self.laws.rubs else v
        self.drive.warm(self.q, self.v, u)
        self._remember()
        self.time += self.drive.step

    def _stepped(self, u: ndarray, h: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """Integrate a step of h [s] (R, 1) from here; return position, velocity, and the way in which friction acted.

        What depends on time alone is taken over the whole step, also where h is a part of it.
        """
        q, v, t = self._q, self._v, self.time
        half = 0.5 * self.drive.step
        sign, stuck = self._stick(q, v, u)
        a1 = self._acceleration(q, v, u, t, sign, stuck)
        v2 = v + 0.5 * h * a1
        a2 = self._acceleration(q + 0.5 * h * v, v2, u, t + half, sign, stuck)
        v3 = v + 0.5 * h * a2
        a3 = self._acceleration(q + 0.5 * h * v2, v3, u, t + half, sign, stuck)
        v4 = v + h * a3
        a4 = self._acceleration(q + h * v3, v4, u, t + 2 * half, sign, stuck)
        return q + h / 6 * (v + 2 * (v2 + v3) + v4), v + h / 6 * (a1 + 2 * (a2 + a3) + a4), sign

    def _until_a_turn(self, v: ndarray, sign: ndarray, u: ndarray) -> ndarray:
        """Share of the step after which the first joint with friction turns round (R, 1); 1 where none does."""
        turned = (sign * v < 0) & (self._v != 0)
        if not (self.laws.rubs and turned.any()):
            return np.ones((len(v), 1))
        force = self._loads(self._q, self._v, u, self.time)[2]
        turned &= self._friction(sign, np.zeros_like(v), force) > 0
        share = np.where(turned, self._v / np.where(turned, self._v - v, 1.0), 1.0)
        return share.min(1, keepdims=True)

    def _loads(self, q: ndarray, v: ndarray, u: ndarray, t: float) -> tuple[ndarray, ndarray, ndarray]:
        """M, all forces but dry friction, and the actuators' alone."""
        inertia, bias = self.equations.terms(q[:, : self.joints], v[:, : self.joints])
        M = inertia + np.diag(self.laws.armature)
        n = self.joints
        force = self.drive.force(self._actuated(q), self._actuated(v), u)
        tau = force + self.laws.smooth(q[:, :n], v[:, :n], t) - bias
        if self.hysteresis:
            tau[:, self.hysteresis.joint] -= self.hysteresis.amplitude * self._memory
        if not self.mass:
            return M, tau, force
        M = np.pad(M, ((0, 0), (0, 1), (0, 1)))
        j, stretch = self.mass.joint, q[:, -1] - q[:, self.mass.joint]
        M[:, -1, -1] = self.mass.mass
        if self.mass.driven:  # a rotor is a part of what its joint moves
            M[:, j, j] -= self.mass.mass
        beyond = np.sign(stretch) * np.maximum(np.abs(stretch) - 0.5 * self.mass.gap, 0.0)
        touch = (beyond != 0) | (self.mass.gap == 0)
        tie = self.mass.stiffness * beyond + self.mass.damping * (v[:, -1] - v[:, j]) * touch
        drives = force[:, j] if self.mass.driven else 0.0
        tau[:, j] += tie - drives
        return M, np.column_stack([tau, drives - tie]), force

    def _actuated(self, x: ndarray) -> ndarray:
        """Positions or velocities of what the actuators act on: of a joint with play their own side of it."""
        if not (self.mass and self.mass.driven):
            return x[:, : self.joints]
        seen = x[:, : self.joints].copy()
        seen[:, self.mass.joint] = x[:, -1]
        return seen

    def _friction(self, sign: ndarray, v: ndarray, force: ndarray) -> ndarray:
        n = self.joints
        bound = np.zeros_like(v)
        bound[:, :n] = self.laws.bound(sign[:, :n], v[:, :n], force)
        return bound

    def _acceleration(
        self,
        q: ndarray,
        v: ndarray,
        u: ndarray,
        t: float,
        sign: ndarray,
        stuck: ndarray,
    ) -> ndarray:
        M, tau, force = self._loads(q, v, u, t)
        if self.laws.rubs:
            tau = tau - sign * self._friction(sign, v, force)
        return _solve(M, tau, stuck)

    def _stick(self, q: ndarray, v: ndarray, u: ndarray) -> tuple[ndarray, ndarray]:
        """Return the way in which each joint slips or breaks away, and the joints that hold."""
        sign, stuck = np.sign(v), v == 0
        if not self.laws.rubs:
            return sign, np.zeros_like(stuck)
        if not stuck.any():
            return sign, stuck
        M, tau, force = self._loads(q, v, u, self.time)
        for _ in range(v.shape[1]):
            moving = tau - sign * self._friction(sign, v, force)
            held = moving - np.einsum("rij,rj->ri", M, _solve(M, moving, stuck))
            # A frictionless joint is never held, even when nothing loads it.
            bound = self._friction(np.sign(held), v, force)
            loose = stuck & ((np.abs(held) > bound) | (bound == 0))
            if not loose.any():
                break
            sign, stuck = np.where(loose, np.sign(held), sign), stuck & ~loose
        return sign, stuck

    def _stopped(self, v: ndarray, sign: ndarray, u: ndarray) -> ndarray:
        """Velocities after the joints that turned round within the step were stopped."""
        still = np.zeros_like(v)
        turned = sign * v < 0
        if not turned.any():
            return v
        M, _, force = self._loads(self._q, v, u, self.time)
        turned &= self._friction(sign, still, force) > 0
        kick = _solve(M, np.einsum("rij,rj->ri", M, np.where(turned, v, 0.0)), turned)
        return np.where(turned, 0.0, v + kick)

    def _remember(self) -> None:
        if self.hysteresis:
            moved = self.v[:, self.hysteresis.joint] * self.drive.step / self.hysteresis.width
            goal = np.sign(moved)
            self._memory = goal + (self._memory - goal) * np.exp(-np.abs(moved))


def _solve(M: ndarray, tau: ndarray, held: ndarray) -> ndarray:
    """a with M a = tau on the free coordinates and a = 0 on the held ones."""
    if held.any():
        free = ~held
        M = np.where(free[:, :, None] & free[:, None, :], M, np.eye(M.shape[1]))
        tau = np.where(free, tau, 0.0)
    if M.shape[1] == 1:
        return tau / M[:, :, 0]
    return np.linalg.solve(M, tau[..., None])[..., 0]
