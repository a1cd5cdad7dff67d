"""The standard machine of the effect pages: a pendulum with a motor, and one specimen of every effect that it can have.

    m l^2 a = u - m g l sin q - d v + effect,      m = .4 kg, l = .3 m, d = .04 N m s/rad; m and d are free

Six runs under sums of sines, chirps and steps; the angle is read every 5 ms with 1 mrad of noise. Data and model share
one simulator and one time step: what is seen is the effect, not an integrator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import mujoco
import numpy as np
import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from envs.driven_pendulum import MODEL
from envs.driven_pendulum.rig import DAMPING, MASS
from envs.rigs.inputs import inputs
from onlinebayes.criticism import propose
from onlinebayes.identification import MEMORY, Windows, make_windows
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import generator
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.sensing import sense

FREE = ParameterSpace({MASS: Parameter(0.1, 1.0, "kg"), DAMPING: Parameter(0.0, 0.1, "N m s/rad")})
BASE = {MASS: 0.4, DAMPING: 0.04}
RUNS, SECONDS, STEP, EVERY = 6, 6.0, 0.0025, 2
AMPLITUDE, BAND = 0.55, (0.2, 2.5)  # [N m], [Hz]
NOISE = 1e-3  # [rad]
HORIZON = 1.0  # [s]

SPECIMENS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "viscous_friction@hinge": {"damping": 0.005},
        "dry_friction@hinge": {"frictionloss": 0.025},
        "stribeck_friction@hinge": {"coulomb": 0.015, "static": 0.045, "stribeck_velocity": 0.5},
        "load_dependent_friction@hinge": {"mu": 0.08},
        "asymmetric_friction@hinge": {"frictionloss_positive": 0.008, "frictionloss_negative": 0.02},
        "quadratic_drag@hinge": {"drag": 0.003},
        "joint_stiffness@hinge": {"stiffness": 0.025, "springref": 0.3},
        "cubic_stiffness@hinge": {"stiffness3": 0.025, "springref": 0.0},
        "constant_load@hinge": {"load": 0.01},
        "cogging@hinge": {"amplitude": 0.02, "poles": 10.0, "phase": 0.5},
        "armature@hinge": {"armature": 0.001},
        "payload@bob": {"mass": 0.01},
        "com_offset@bob.x": {"x": 0.0025},
        "gravity_tilt@world.x": {"angle": 0.008},
        "actuator_gain@motor": {"gain": -0.03},
        "actuator_lag@motor": {"time_constant": 0.008},
        "actuator_delay@motor": {"delay": 0.008},
        "actuator_dead_zone@motor": {"width": 0.03},
        "actuator_saturation@motor": {"limit": 0.7},
        "back_emf@motor": {"constant": 0.005},
        "thermal_derating@motor": {"coefficient": 1.0, "time_constant": 2.0},
        "sensor_bias@qpos.hinge": {"bias": 0.008},
        "sensor_scale@qpos.hinge": {"scale": 0.03},
        "sensor_delay@qpos.hinge": {"delay": 0.008},
    }
)
"""One value of every effect, large enough to be seen, along the axis that it has here (``name@target`` -> values)."""


@dataclass(frozen=True)
class Recording:
    """R runs of the machine.

    Args:
        measurement: what the encoder read.
        exact: the same without noise, after every time step (R, T) [rad].
        command: held over every time step (R, T) [N m].
    """

    measurement: Measurement
    exact: Float[Tensor, "R T"]
    command: Float[Tensor, "R T"]


def machine(free: ParameterSpace = FREE) -> MujocoSimulator:
    """The model without any effect; what is not free has its true value."""
    spec = mujoco.MjSpec.from_file(str(MODEL))
    spec.body("bob").mass = BASE[MASS]
    spec.joint("hinge").damping[0] = BASE[DAMPING]
    return MujocoSimulator(spec, free, threads=1)


def record(effect: Effect | None = None, values: Mapping[str, float] | None = None, seed: int = 0) -> Recording:
    """Drive the machine, with an effect of these values or with none.

    Args:
        effect, values: what it has that the model lacks [SI].
        seed: of commands and noise.
    """
    real = machine() if effect is None else machine().with_effect(effect)
    own = {} if effect is None else {f"{effect.key}.{name}": value for name, value in (values or {}).items()}
    theta = real.parameters.vector({**BASE, **own}).expand(RUNS, -1)
    logged = EVERY * STEP * np.arange(round(SECONDS / (EVERY * STEP)))
    drawn = AMPLITUDE * inputs(logged, (RUNS, 1), BAND, np.random.default_rng(seed))[..., 0].T
    command = torch.as_tensor(drawn).repeat_interleave(EVERY, dim=1)
    steps = command.shape[1]
    state = TensorDict({"qpos": torch.zeros(RUNS, 1).double(), "qvel": torch.zeros(RUNS, 1).double()}, [RUNS])
    times = STEP * torch.arange(1, steps + 1, dtype=torch.float64)
    trajectory = real.rollout(theta, state, TensorDict({"command": command[..., None]}, [RUNS, steps]), times)
    exact = sense(real, theta, state, trajectory, times)[..., real.signals.index("qpos.hinge")]
    # A row holds the angle at its instant and the command from then on; at the first instant nothing has moved yet.
    return Recording(_measurement(exact[:, EVERY - 1 : -EVERY : EVERY], drawn[:, 1:], logged[1:], seed), exact, command)


def windows_of(recording: Recording) -> Windows:
    """The recording as criticism cuts it."""
    return make_windows(machine(), recording.measurement, HORIZON, MEMORY * HORIZON)


def specimen_effects(windows: Windows) -> dict[str, Effect]:
    """The effects of ``SPECIMENS`` with the bounds that ``diagnose`` would give them after the bare machine's runs."""
    return {effect.key: effect for effect in propose(machine(), windows, tuple(SPECIMENS))}


def _measurement(exact: Float[Tensor, "R K"], command: np.ndarray, times: np.ndarray, seed: int) -> Measurement:
    draw = generator(seed)
    read = (exact + NOISE * torch.randn(exact.shape, generator=draw, dtype=exact.dtype)).numpy()
    runs = {f"run{r}": {"time": times, "ctrl.motor": command[r], "qpos.hinge": read[r]} for r in range(len(read))}
    return Measurement.from_runs(runs, signals=[Signal("qpos.hinge", "rad", sd=NOISE)], commands=["motor"])
