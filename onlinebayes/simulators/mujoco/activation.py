"""Activations of actuators along known commands, no physics simulated: MuJoCo's own recurrences, whole rows at once.

    filter:       a_{k+1} = clip(u + c (a - u)),   c = 1 - phi z,            z = h / tau, tau = dynprm[0]
    filterexact:  the same,                        c = 1 - phi (1 - e^-z)
    integrator:   a_{k+1} = clip(a + h u)

(MuJoCo: Computation, "Actuation model".) u is clipped to ctrlrange, a to actrange. phi is 1, and under Runge and
Kutta's method the mean of the stages' slopes. Over n timesteps of one command c becomes c^n.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.simulators.mujoco.addresses import model_array
from onlinebayes.simulators.mujoco.host import to_host
from onlinebayes.simulators.mujoco.recall import driven
from onlinebayes.simulators.mujoco.system import MujocoSystem

FORGOTTEN = 10.0
"""Time constants after which e^-10, less than what sensors tell, is left of how an activation began."""

WIDER = 4.0
"""Times its nominal value: as long a time constant as a free one is taken for."""

MEMORY = 2**24
"""Numbers that the commands of some worlds may take together (128 MiB)."""

DYN = mujoco.mjtDyn
FILTERS = (DYN.mjDYN_FILTER, DYN.mjDYN_FILTEREXACT)
INTEGRATING = (DYN.mjDYN_INTEGRATOR, DYN.mjDYN_PID)
MUSCLE_SLOWEST = 2.0  # times dynprm: a muscle's time constant at full activation


@dataclass(frozen=True)
class Recurrence:
    """One activation over rows of one command: a <- clip(c a + b u).

    Args:
        ctrl, act: its actuator's place in ``ctrl``, its own in ``act``.
        factor: c of each world (N, 1) [1].
        gain: b of each world (N, 1) [activation per command].
        start: at the first row, or None where it has settled there.
        ctrl_range, act_range: limits (N, 2), None without.
    """

    ctrl: int
    act: int
    factor: Float[Tensor, "N 1"]
    gain: Float[Tensor, "N 1"]
    start: float | None
    ctrl_range: Float[Tensor, "N 2"] | None
    act_range: Float[Tensor, "N 2"] | None

    def along(self, ctrl: Float[Tensor, "N K nu"]) -> Float[Tensor, "N K1"]:
        """The activation before the first row and after each."""
        u = _clipped(ctrl[..., self.ctrl], self.ctrl_range)
        first = u[:, :1] if self.start is None else torch.full_like(u[:, :1], self.start)
        first = _clipped(first, self.act_range) if self.start is None else first
        if self.act_range is None and bool((self.factor.abs() <= 1).all()):
            return _scan(torch.cat([first, self.gain * u], dim=1), self.factor)
        line = [first]
        for k in range(u.shape[1]):
            line.append(_clipped(self.factor * line[-1] + self.gain * u[:, k : k + 1], self.act_range))
        return torch.cat(line, dim=1)


def activations(
    system: MujocoSystem, theta: Float[Tensor, "N P"], command: Float[Tensor, "N K U"], step: float
) -> dict[str, Tensor]:
    """``"act"`` along commands where all is filters or integrators; see ``Identifiable.command_driven_states``."""
    model, h = system.model, float(system.model.opt.timestep)
    if not _followed(model):
        return {}
    steps, command = max(1, round(step / h)), command.double()
    # Stages change the command within a row; a filter that overshoots may touch its limit and come back.
    fine = bool(system.stages) or any(r.act_range is not None and r.factor.min() < 0 for r in _all(system, theta, 1))
    parts, held = (steps, 1) if fine else (1, steps)
    size = max(1, MEMORY // max(1, parts * command.shape[1] * model.nu))
    pieces = [
        _activations(system, theta[i : i + size], command[i : i + size].repeat_interleave(parts, 1), step / parts, held)
        for i in range(0, len(theta), size)
    ]
    return {"act": torch.cat([piece[:, ::parts] for piece in pieces])}


def _activations(
    system: MujocoSystem, theta: Float[Tensor, "N P"], command: Float[Tensor, "N K U"], step: float, steps: int
) -> Float[Tensor, "N K1 na"]:
    """Of some worlds, each row ``step`` seconds and ``steps`` timesteps long."""
    ctrl = driven(system, theta, system.rest(len(theta), step), command, step)
    act = ctrl.new_zeros(len(theta), command.shape[1] + 1, system.model.na)
    for one in _all(system, theta, steps):
        act[..., one.act] = one.along(ctrl)
    return act


def memory_span(system: MujocoSystem) -> float:
    """See :attr:`onlinebayes.simulators.base.Simulator.memory_span`."""
    model = system.model
    forgetful = [i for i in range(model.nu) if int(model.actuator_dyntype[i]) in (*FILTERS, DYN.mjDYN_MUSCLE)]
    if not forgetful:
        return 0.0
    nominal = system.nominal[None]
    longest = nominal.clone()
    for column, address in enumerate(system.addresses):
        if any(cell.array == "actuator_dynprm" for cell in address.cells):
            high = system.parameters.high[column]
            longest[:, column] = torch.maximum(nominal[:, column], high.clamp_max(WIDER * nominal[0, column]))
    constants = _field(system, "actuator_dynprm", system.write(to_host(longest)))[0]
    filters = [float(constants[i, 0]) for i in forgetful if int(model.actuator_dyntype[i]) in FILTERS]
    muscles = [float(constants[i, :2].max()) for i in forgetful if int(model.actuator_dyntype[i]) == DYN.mjDYN_MUSCLE]
    return FORGOTTEN * max(*filters, *(MUSCLE_SLOWEST * slowest for slowest in muscles), 0.0)


def _followed(model: mujoco.MjModel) -> bool:
    """Check whether every activation follows one of the module's equations."""
    stateful = [i for i in range(model.nu) if model.actuator_actnum[i]]
    known = all(
        model.actuator_actnum[i] == 1 and int(model.actuator_dyntype[i]) in (*FILTERS, DYN.mjDYN_INTEGRATOR)
        for i in stateful
    )
    disabled = model.opt.disableactuator or model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION
    return bool(stateful) and known and not disabled and not model.nhistory


def _all(system: MujocoSystem, theta: Float[Tensor, "N P"], steps: int) -> list[Recurrence]:
    """Every activation over ``steps`` timesteps of one command; integrators begin where the first keyframe has them."""
    model, fields = system.model, system.write(to_host(theta))
    h, N = float(model.opt.timestep), len(theta)
    free = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    ranges = {name: _field(system, f"actuator_{name}", fields).expand(N, -1, -1) for name in ("ctrlrange", "actrange")}
    found = []
    for i in range(model.nu):
        if not model.actuator_actnum[i]:
            continue
        act, start = int(model.actuator_actadr[i]), None
        if int(model.actuator_dyntype[i]) == DYN.mjDYN_INTEGRATOR:
            factor = torch.ones(N, 1, dtype=torch.float64)
            gain = steps * h * factor
            start = float(model.key_act[0, act]) if model.nkey else 0.0
        else:
            tau = _field(system, "actuator_dynprm", fields)[:, i, :1].clamp_min(mujoco.mjMINVAL).expand(N, 1)
            factor = _factor(h / tau, int(model.actuator_dyntype[i]), int(model.opt.integrator)) ** steps
            gain = 1 - factor
        found.append(
            Recurrence(
                i,
                act,
                factor,
                gain,
                start,
                ranges["ctrlrange"][:, i] if model.actuator_ctrllimited[i] and not free else None,
                ranges["actrange"][:, i] if model.actuator_actlimited[i] else None,
            )
        )
    return found


def _factor(z: Float[Tensor, "N 1"], kind: int, integrator: int) -> Float[Tensor, "N 1"]:
    """Return the fraction of a filter's distance from its command that is left after a timestep [1]."""
    phi = torch.ones_like(z)
    if integrator == mujoco.mjtIntegrator.mjINT_RK4:
        phi = 1 - z / 2 + z**2 / 6 - z**3 / 24
    return 1 - phi * (z if kind == DYN.mjDYN_FILTER else -torch.expm1(-z))


def _scan(values: Float[Tensor, "N K"], factor: Float[Tensor, "N 1"]) -> Float[Tensor, "N K"]:
    """x_k = c x_{k-1} + values_k for all k at once: spans that are summed double until nothing is left of c."""
    line, span = values.clone(), 1
    while span < line.shape[1] and float(factor.abs().max()) > math.ulp(1.0) ** 2:
        line[:, span:] = line[:, span:] + factor * line[:, :-span]
        factor, span = factor**2, 2 * span
    return line


def _field(system: MujocoSystem, name: str, fields: dict) -> Tensor:
    """A field of N worlds where it differs between them, else of one."""
    return torch.as_tensor(fields[name] if name in fields else model_array(system.model, name)[None].copy())


def _clipped(x: Tensor, bounds: Float[Tensor, "N 2"] | None) -> Tensor:
    return x if bounds is None else torch.minimum(torch.maximum(x, bounds[:, :1]), bounds[:, 1:])
