"""Commands on large inputs, each in a process of its own: processor time and memory.

| input          | command   | what it is                                                             |
|----------------|-----------|------------------------------------------------------------------------|
| 60 joints      | `init`    | ten legs of six hinges with position servos, 20 s at 50 Hz             |
| 10^6 rows      | `compare` | a pendulum with a motor and hidden dry friction, 1000 s at 1 kHz       |
| a case's files | `compare` | what nobody answered in time before (``cases/front-door``)             |
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

GRACE_S = 20.0
"""Processor time after which a command that was asked to stop is stopped at once [s]."""
FRICTION = 0.05
PENDULUM = """<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody><body name="link">
<joint name="hinge" axis="0 1 0" damping="0.03"{}/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".02" mass=".5"/>
</body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""


@dataclass(frozen=True)
class Spent:
    """Cost of a command.

    Args:
        processor: time of all its threads and processes [s].
        memory: largest resident set [GB].
        status: exit status, 130 where it was stopped.
    """

    processor: float
    memory: float
    status: int


def spent(words: list[str], limit: float) -> Spent:
    """Run ``onlinebayes`` with these words; it is asked to stop after ``limit`` seconds of processor time [s]."""
    nothing_kept = {**os.environ, "ONLINEBAYES_CACHE": "off"}
    program = [sys.executable, "-m", "onlinebayes", *words]
    process = subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=nothing_kept)
    while not (found := os.wait4(process.pid, os.WNOHANG))[0]:
        if _processor(process.pid) > limit:
            process.terminate()  # a job of a shell in the background would not heed SIGINT
            limit += GRACE_S
        time.sleep(0.1)
    _, status, usage = found
    process.returncode = os.waitstatus_to_exitcode(status)
    return Spent(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024**2, process.returncode)


def _processor(pid: int) -> float:
    """Processor time of a process and of its copies that have ended, until now [s]."""
    numbers = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return sum(int(ticks) for ticks in numbers[11:15]) / os.sysconf("SC_CLK_TCK")


def many_joints(folder: Path, legs: int = 10, links: int = 6) -> list[str]:
    """Words of ``init`` for a machine of ten legs of six joints."""
    body = ""
    servos = ""
    for leg in range(legs):
        chain = ""
        for k in range(links):
            name = f"leg{leg}_{k}"
            axis = "0 1 0" if k % 2 else "1 0 0"
            chain += (
                f'<body name="{name}" pos="0 0 {-0.1 if k else 0}"><joint name="{name}" axis="{axis}" damping=".2" '
                f'armature=".01"/><geom type="capsule" fromto="0 0 0 0 0 -.1" size=".01" mass=".1"/>'
            )
            servos += f'<position name="{name}" joint="{name}" kp="20" kv=".5"/>'
        body += f'<body pos="{0.3 * leg} 0 1">{chain}{"</body>" * links}</body>'
    option = '<option timestep="0.002" integrator="implicitfast"><flag contact="disable"/></option>'
    xml = f"<mujoco>{option}<worldbody>{body}</worldbody><actuator>{servos}</actuator></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    rng = np.random.default_rng(0)
    rate, phase = rng.uniform(1, 6, model.nu), rng.uniform(0, 6, model.nu)
    _record(folder, xml, model, lambda t: 0.4 * np.sin(rate * t + phase), rows=1000, steps=10)
    return ["init", str(folder / "model.xml"), str(folder / "log.csv"), "--out", str(folder / "p.toml"), "--force"]


def many_rows(folder: Path, rows: int = 10**6) -> list[str]:
    """Words of ``compare`` for a log of so many rows."""
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(f' frictionloss="{FRICTION}"'))
    _record(folder, PENDULUM.format(""), model, lambda t: 0.8 * np.sin(3 * t) + 0.5 * np.sin(7.1 * t), rows, steps=1)
    problem = 'schema = 1\nmodel = "model.xml"\nmeasurements = ["log.csv"]\n[parameters]\n'
    problem += '"joint.hinge.damping" = [0.0, 0.2]\n"body.link.mass" = [0.1, 1.5]\n'
    (folder / "p.toml").write_text(problem, encoding="utf-8")
    return ["compare", str(folder / "p.toml"), "--out", str(folder / "out")]


def _record(folder: Path, xml: str, model: mujoco.MjModel, told: Callable[[float], Any], rows: int, steps: int) -> None:
    """A model's file, and a log of what a machine does that is commanded so."""
    folder.mkdir(parents=True)
    (folder / "model.xml").write_text(xml, encoding="utf-8")
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    table = np.empty((rows, 1 + model.nu + model.nq))
    for k in range(rows):
        data.ctrl[:] = told(data.time)
        table[k] = (data.time, *data.ctrl, *data.qpos)
        for _ in range(steps):
            mujoco.mj_step(model, data)
    table[:, 1 + model.nu :] += 2e-4 * rng.normal(size=(rows, model.nq))
    motors = [f"ctrl.{model.actuator(k).name}" for k in range(model.nu)]
    names = ["time", *motors, *(f"qpos.{model.joint(k).name}" for k in range(model.njnt))]
    np.savetxt(folder / "log.csv", table, fmt="%.6g", delimiter=",", header=",".join(names), comments="")
