"""The figures that the thesis prints in its Tables 4.1 and 5.1 [nats] and 5.2, and the columns here of its methods."""

from __future__ import annotations

REJECTION, EPSILON_FREE, FOURIER, NETWORK = (
    "rejection ABC",
    "epsilon-free",
    "Fourier features",
    "network as published",
)
LOOP = "LSTM in the loop"


def _one_round(rejection: float, epsilon_free: float, fourier: float, network: float) -> dict[str, float]:
    return {REJECTION: rejection, EPSILON_FREE: epsilon_free, FOURIER: fourier, NETWORK: network}


def _online(online: float, fourier: float, epsilon_free: float) -> dict[str, float]:
    return {LOOP: online, FOURIER: fourier, EPSILON_FREE: epsilon_free}


TABLE_4_1: dict[str, dict[str, float]] = {
    "CartPole length": _one_round(-0.342, -0.211, -0.609, -0.657),
    "CartPole mass": _one_round(0.032, 0.056, 0.973, 0.633),
    "Pendulum dt": _one_round(2.101, 2.307, 3.192, 3.199),
    "Mountain Car power": _one_round(3.69, 3.800, 3.863, 3.901),
    "Acrobot m1": _one_round(1.704, 1.883, 2.046, 1.331),
    "Acrobot m2": _one_round(1.832, 2.237, 0.321, 1.513),
    "Acrobot L1": _one_round(2.421, 2.135, 2.072, 1.856),
    "Acrobot L2": _one_round(-0.521, -0.703, -0.148, -0.672),
    "Hopper friction": _one_round(3.032, 3.154, 2.622, 3.391),
    "Fetch Push friction": _one_round(1.332, 2.013, 2.423, 2.404),
    "Fetch Slide friction": _one_round(1.014, 1.614, 2.391, 2.111),
}
TABLE_5_1: dict[str, dict[str, float]] = {
    "CartPole": _online(4.66, 2.68, 2.88),
    "Pendulum": _online(4.076, 3.89, 3.332),
    "Fetch Push": _online(2.09, 2.18, 2.10),
    "Fetch Slide": _online(3.24, 3.12, 2.55),
    "Hopper": _online(3.25, 3.134, 3.384),
    "Acrobot, masses": _online(2.85, 1.534, 1.210),
    "Acrobot, lengths": _online(2.25, 1.426, 1.012),
}
TABLE_5_2 = {"prior": "2.39 ± 0.48", "first posterior": "0.37 ± 0.35", "second posterior": "0.36 ± 0.32"}
"""Plans for -> mean cost of a drive, of a cost that the thesis does not name."""
