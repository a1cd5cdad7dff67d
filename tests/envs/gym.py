"""The reference: Gymnasium's own systems, stepped one world at a time in float64 from given states."""

from __future__ import annotations

import gymnasium
import numpy as np


def cartpole(
    length: float = 0.5, mass: float = 0.1, masscart: float = 1.0, gravity: float = 9.8, force: float = 10.0
) -> gymnasium.Env:
    """CartPole with changed physics, the masses that Gymnasium caches at construction included."""
    env = gymnasium.make("CartPole-v1").unwrapped
    env.length, env.masspole, env.masscart, env.gravity, env.force_mag = length, mass, masscart, gravity, force
    env.total_mass = mass + masscart
    env.polemass_length = mass * length
    env.reset(seed=0)
    return env


def pendulum(length: float = 1.0, mass: float = 1.0, gravity: float = 10.0) -> gymnasium.Env:
    """Pendulum with changed physics."""
    env = gymnasium.make("Pendulum-v1").unwrapped
    env.l, env.m, env.g = length, mass, gravity
    env.reset(seed=0)
    return env


def trajectory(env: gymnasium.Env, state: np.ndarray, actions: np.ndarray) -> tuple[np.ndarray, ...]:
    """States, rewards and terminations over ``actions`` from ``state``, stepping on past the end of an episode."""
    env.state = np.array(state, dtype=np.float64)
    rows = []
    for action in actions:
        env.steps_beyond_terminated = None  # CartPole: each state's own verdict and reward, not the episode's
        _, reward, terminated, _, _ = env.step(action)
        rows.append((env.state.copy(), reward, terminated))
    states, rewards, terminated = zip(*rows, strict=True)
    return np.stack(states), np.array(rewards), np.array(terminated)
