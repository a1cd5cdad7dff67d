"""Problems drawn at random, small enough for a refine of a second: machines, logs with faults, problem files.

Every draw is a problem that a user may have. What a draw holds is plain data, so that a failing one can be read.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from hypothesis import strategies as st

from onlinebayes.runs import to_toml

STEP = 0.01


@dataclass(frozen=True)
class Machine:
    """A model, the addresses that may be free with their bounds, and the effects that may be hidden or tried."""

    xml: str
    free: dict[str, tuple[float, float]]
    effects: tuple[str, ...]
    drive: float


CART = Machine(
    """<mujoco><option timestep="0.005" integrator="implicitfast"/><worldbody><body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" damping="2" frictionloss="0.2" armature="0.1"/>
      <geom name="cart" type="box" size=".1 .1 .1" mass="3"/><site name="top" pos="0 0 .1"/>
    </body></worldbody><actuator><motor name="motor" joint="rail" gear="2"/></actuator></mujoco>""",
    {
        "body.cart.mass": (1.0, 9.0),
        "body.c*.mass": (1.0, 9.0),
        "joint.rail.damping": (0.0, 9.0),
        "joint.rail.frictionloss": (0.0, 2.0),
        "joint.*.armature": (0.0, 1.0),
        "actuator.motor.gear[0]": (0.5, 6.0),
        "option.gravity[2]": (-12.0, -8.0),
    },
    ("dry_friction@rail", "viscous_friction@rail", "constant_load@rail", "payload@top", "actuator_delay@motor"),
    4.0,
)
SERVOS = Machine(
    """<mujoco><option timestep="0.005" integrator="implicitfast"/><worldbody><body name="upper">
      <joint name="a.1" axis="0 1 0" damping=".2"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4" mass="1"/>
      <body name="lower" pos="0 0 -.4"><joint name="b.2" axis="0 1 0" damping=".1"/>
        <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass=".5"/></body></body></worldbody>
    <actuator><position name="lift" joint="a.1" kp="20" kv="1"/><position name="bend" joint="b.2" kp="10" kv=".5"/>
    </actuator></mujoco>""",
    {
        "actuator.*.kp": (1.0, 80.0),
        "actuator.lift.kp": (5.0, 80.0),
        "joint.*.damping": (0.0, 2.0),
        "joint.a.1.damping": (0.0, 2.0),
        "body.lower.mass": (0.1, 2.0),
        "body.lower.ipos[0]": (-0.1, 0.1),
        "body.*.mass": (0.1, 4.0),
    },
    ("constant_load@a.1", "dry_friction@b.2", "backlash@a.1", "sensor_bias@qpos.b.2", "gravity_tilt@world"),
    0.5,
)
PENDULUM = Machine(
    """<mujoco><option timestep="0.01" integrator="RK4"/><worldbody><body name="rod">
      <joint name="hinge" axis="0 1 0" damping="0.03"/>
      <inertial pos="0 0 -0.4" mass="1" diaginertia="0.01 0.01 0.001"/>
    </body></worldbody><sensor><jointpos name="encoder" joint="hinge"/></sensor></mujoco>""",
    {
        "body.rod.mass": (0.3, 3.0),
        "joint.hinge.damping": (1e-3, 0.5),
        "body.rod.inertia[1]": (0.001, 0.1),
        "joint.h?nge.frictionloss": (0.0, 0.3),
    },
    ("quadratic_drag@hinge", "dry_friction@hinge", "com_offset@rod", "sensor_scale@qpos.hinge"),
    0.0,
)


@dataclass(frozen=True)
class Log:
    """How a machine is recorded.

    Args:
        rows: of each run.
        noise: of the sensors [SI].
        hidden: effects on the machine that the model lacks, as changes of the model's own fields: field -> factor.
        speeds: whether velocities are logged.
        fault: what is wrong with the table.
        seed: of commands, starts and noise.
    """

    rows: tuple[int, ...]
    noise: float
    hidden: dict[str, float]
    speeds: bool
    fault: str
    seed: int


@dataclass(frozen=True)
class Drawn:
    """A drawn problem."""

    machine: Machine
    log: Log
    content: dict[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """The model, the table and the problem file, in a folder."""
        (folder / "model.xml").write_text(self.machine.xml)
        with (folder / "log.csv").open("w", newline="") as file:
            table = _table(self.machine, self.log)
            writer = csv.DictWriter(file, list(table[0]))
            writer.writeheader()
            writer.writerows(table)
        (folder / "problem.toml").write_text(to_toml(self.content))
        return folder / "problem.toml"


FAULTS = (
    "none",
    "none",
    "none",
    "sign",
    "degrees",
    "ahead",
    "late start",
    "lost cells",
    "still",
    "off",
    "swapped time",
)
RUNS = tuple(f"run{k}" for k in range(11))


@st.composite
def problems(draw: st.DrawFn) -> Drawn:
    """A machine, a log of it, and a problem file."""
    machine = draw(st.sampled_from([CART, SERVOS, PENDULUM]))
    log = Log(
        rows=tuple(draw(st.lists(st.sampled_from([40, 40, 30, 25, 9]), min_size=2, max_size=8))),
        noise=draw(st.sampled_from([1e-4, 1e-3, 0.0])),
        hidden=draw(st.dictionaries(st.sampled_from(sorted(HIDDEN)), st.sampled_from([0.5, 3.0, 9.0]), max_size=2)),
        speeds=draw(st.booleans()),
        fault=draw(st.sampled_from(FAULTS)),
        seed=draw(st.integers(0, 1000)),
    )
    return Drawn(machine, log, draw(_contents(machine, RUNS[: len(log.rows)])))


@st.composite
def _contents(draw: st.DrawFn, machine: Machine, runs: tuple[str, ...]) -> dict[str, Any]:
    """The problem file."""
    names = draw(st.lists(st.sampled_from(sorted(machine.free)), min_size=0, max_size=3, unique_by=_field))
    scopes = ("shared", "shared", "per_run")
    content: dict[str, Any] = {
        "model": "model.xml",
        "measurements": ["log.csv"],
        "parameters": {name: _bounds(draw, machine, name, draw(st.sampled_from(scopes))) for name in names},
    }
    known = [name for name in machine.free if not _is_glob(name) and _field(name) not in map(_field, names)]
    if known and draw(st.booleans()):
        name = draw(st.sampled_from(sorted(known)))
        content["runs"] = {draw(st.sampled_from([runs[0], "run*"])): {name: float(np.mean(machine.free[name]))}}
    if draw(st.booleans()):
        content["holdout"] = [draw(st.sampled_from([runs[-1], runs[0]]))]
    effects = draw(st.lists(st.sampled_from(machine.effects), min_size=1, max_size=2, unique=True))
    content["effects"] = {"candidates": effects}
    if draw(st.integers(0, 3)) == 0:
        content["effects"]["add"] = [draw(st.sampled_from(machine.effects))]
        if draw(st.booleans()):
            content["effects"]["scope"] = {content["effects"]["add"][0]: "per_run"}
    if draw(st.integers(0, 3)):
        content["selection"] = {"horizon_s": draw(st.sampled_from([0.1, 0.2]))}  # so short that the data are enough
    if any(scope.get("scope") == "per_run" for scope in content["parameters"].values()) and draw(st.booleans()):
        content["groups"] = ["run[01]", "run[2-9]"] if len(runs) > 2 else ["run*"]
    return content


def _bounds(draw: st.DrawFn, machine: Machine, name: str, scope: str) -> dict[str, Any]:
    low, high = machine.free[name]
    found: dict[str, Any] = {"low": low, "high": high, "scope": scope}
    if _is_glob(name) and draw(st.booleans()):
        found["tie"] = True
    if low > 0 and draw(st.booleans()):
        found["scale"] = "log"
    return found


def _is_glob(name: str) -> bool:
    return "*" in name or "?" in name


def _field(name: str) -> str:
    """Two addresses of one field may be the same value."""
    kind, _, rest = name.partition(".")
    return f"{kind}.{rest.rpartition('.')[2]}"


HIDDEN = ("dof_damping", "dof_frictionloss", "body_mass", "dof_armature", "actuator_gainprm")


def _table(machine: Machine, log: Log) -> list[dict[str, Any]]:
    """The rows of the log."""
    model, random = mujoco.MjModel.from_xml_string(machine.xml), np.random.default_rng(log.seed)
    for name, factor in log.hidden.items():
        getattr(model, name)[...] *= factor
        if name == "dof_frictionloss":
            model.dof_frictionloss[:] += 0.1 * factor
    if "actuator_gainprm" in log.hidden and model.nu:
        model.actuator_biasprm[:, 1] = np.where(model.actuator_biasprm[:, 1] != 0, -model.actuator_gainprm[:, 0], 0.0)
    table: list[dict[str, Any]] = []
    for name, rows in zip(RUNS, log.rows, strict=False):
        table += _run(model, machine, log, name, rows, random)
    return table


def _run(
    model: mujoco.MjModel, machine: Machine, log: Log, name: str, rows: int, random: np.random.Generator
) -> list[dict[str, Any]]:
    data, found = mujoco.MjData(model), []
    data.qpos[:] = 0.0 if model.nu else random.uniform(-1, 1, model.nq)
    rate, phase = random.uniform(2, 12, model.nu), random.uniform(0, 6, model.nu)
    still = log.fault == "still" and name == "run1"
    for k in range(rows):
        command = 0.0 * rate if still else machine.drive * np.sin(rate * k * STEP + phase)
        row: dict[str, Any] = {"run": name, "time": f"{k * STEP:.4f}"}
        row |= {f"ctrl.{model.actuator(u).name}": f"{command[u]:.6f}" for u in range(model.nu)}
        off = log.fault == "off" and name == "run0" and rows / 3 < k < 2 * rows / 3
        row |= {f"enable.{model.actuator(u).name}": int(not off) for u in range(model.nu) if log.fault == "off"}
        row |= _reading(model, data, log, k, random)
        found.append(row)
        if still:
            continue
        data.ctrl[:] = 0.0 * command if off else command
        for _ in range(round(STEP / model.opt.timestep)):
            mujoco.mj_step(model, data)
    return _faulty(found, log, name)


def _reading(
    model: mujoco.MjModel, data: mujoco.MjData, log: Log, k: int, random: np.random.Generator
) -> dict[str, str]:
    factor = {"sign": -1.0, "degrees": 180 / np.pi}.get(log.fault, 1.0)
    noisy = data.qpos + log.noise * random.standard_normal(model.nq)
    speeds = data.qvel + 10 * log.noise * random.standard_normal(model.nv)
    lost = log.fault == "lost cells" and random.uniform() < 0.3
    joints = [model.joint(j).name for j in range(model.njnt)]
    found = {f"qpos.{name}": "" if lost else f"{factor * q:.7f}" for name, q in zip(joints, noisy, strict=True)}
    if log.speeds:
        found |= {f"qvel.{name}": f"{v:.6f}" for name, v in zip(joints, speeds, strict=True)}
    if model.nsensor:
        found["sensor.encoder"] = f"{noisy[0]:.7f}"
    return found


def _faulty(rows: list[dict[str, Any]], log: Log, name: str) -> list[dict[str, Any]]:
    """The run with the faults of its clock."""
    measured = [key for key in rows[0] if key.startswith(("qpos.", "qvel.", "sensor."))]
    if log.fault == "ahead":
        ahead = [{key: row[key] for key in measured} for row in rows[3:]]
        return [{**row, **more} for row, more in zip(rows, ahead, strict=False)]
    if log.fault == "late start" and name == "run1":
        return [row if k >= len(rows) - 4 else {**row, **dict.fromkeys(measured, "")} for k, row in enumerate(rows)]
    if log.fault == "swapped time":
        return [{**row, "time": f"{float(row['time']) + 0.002 * (k % 3 == 0):.4f}"} for k, row in enumerate(rows)]
    return rows
