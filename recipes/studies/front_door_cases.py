"""Logs and models as people gave them (``cases/front-door`` beside the measured data), and what is right for each.

The files are not part of the project; a case whose folder is not there is left out.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from onlinebayes.cli.main import main as command
from onlinebayes.runs import processor_time


@dataclass(frozen=True)
class Case:
    """A command on the files of a folder, and what it says where it is right.

    Args:
        folder: of the case.
        words: command and its files; ``init`` and ``compare`` write to a place of their own.
        right: name of the model -> column that ``init`` matches it with.
        said: other parts of what is printed.
        status: exit status.
    """

    folder: str
    words: str
    right: Mapping[str, str] = field(default_factory=dict)
    said: Sequence[str] = ()
    status: int = 0

    @property
    def wanted(self) -> list[str]:
        """All that must be printed."""
        return [*(f"matched:   {name} <- {column}" for name, column in self.right.items()), *self.said]


@dataclass(frozen=True)
class Answer:
    """What a command did.

    Args:
        lacking: what it should have printed and did not.
        seconds: processor time [s].
        status: exit status.
    """

    lacking: Sequence[str]
    seconds: float
    status: int


def _both(names: Sequence[str], measured: str, told: str, actuators: Sequence[str] = ()) -> dict[str, str]:
    rows = {f"qpos.{name}": measured.format(n=name, k=k) for k, name in enumerate(names)}
    return rows | {
        f"ctrl.{a}": told.format(n=n, k=k) for k, (a, n) in enumerate(zip(actuators or names, names, strict=True))
    }


ARM, LEG, LEGS = ("shoulder", "elbow"), ("FL_thigh_joint", "FL_calf_joint"), ("FL_thigh", "FL_calf")
SO = ("shoulder_lift", "elbow_flex")
UR = tuple(f"{part}_joint" for part in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))
UR_MOTORS = tuple(name.removesuffix("_joint") for name in UR)
OVERLAP = "do not overlap: 'timestamp' goes from 37.209926 to 39.190385 s"
PLAIN = _both(ARM, "{n}_pos", "{n}_cmd")

CASES: tuple[Case, ...] = (
    Case("degrees_unit", "init arm.xml log.csv", _both(SO, "qpos.{n} [deg]", "ctrl.{n} [deg]")),
    Case("degrees_unit", "compare p.toml", said=("degrees for radians", 'unit = "deg"|scale = 0.0174532925')),
    *(
        Case("desired_position_columns", f"init leg.xml {name}.csv", _both(LEG, measured, told, LEGS))
        for name, measured, told in (
            ("suffix", "{n}_pos", "{n}_des_pos"),
            ("dotted", "dof_pos.{n}", "des_dof_pos.{n}"),
            ("index", "dof_pos[{k}]", "des_dof_pos[{k}]"),
            ("desired", "{n}_position", "{n}_desired_position"),
            ("ref", "{n}_q", "{n}_q_ref"),
        )
    ),
    Case(
        "effort_as_servo_command",
        "init arm.xml log.csv",
        _both(("shoulder_joint", "elbow_joint"), "position[{n}]", "reference[{k}]", ARM),
        ("unused:    effort[shoulder_joint], effort[elbow_joint]",),
    ),
    Case("epoch_ns_clock", "init arm.xml log.csv", {"time": "timestamp_ns [ns]", **PLAIN}),
    Case(
        "index_columns",
        "init arm.xml log.csv",
        _both(("joint1", "joint2"), "actual_q_{k}", "target_q_{k}", ("actuator1", "actuator2")),
        ("a guess, by order: check it",),
    ),
    Case(
        "index_columns_q",
        "init arm7.xml log.csv",
        _both([f"joint{k}" for k in range(1, 8)], "q[{k}]", "tau_J_d[{k}]"),
        ("a guess, by order: check it",),
    ),
    Case("joined_tables_epoch_ns", "init arm.xml js/run1.csv cmd/run1.csv", {"time": "stamp_ns [ns]", **PLAIN}),
    Case("joined_tables_epoch_ns", "compare p.toml", said=("joined by 'stamp_ns'", "verdict:")),
    Case(
        "joint_suffix_missing",
        "init arm.xml log.csv",
        {f"qpos.{joint}": f"q_{joint.removesuffix('_joint')}" for joint in LEG}
        | {f"ctrl.{motor}": f"cmd_{motor}" for motor in LEGS},
    ),
    Case(
        "lerobot_pos_names",
        "init arm.xml log.csv",
        _both(SO, "observation.state[{n}.pos]", "action[{n}.pos]"),
    ),
    Case(
        "rtde_two_clocks",
        "init ur5e.xml rtde.csv commander.csv",
        _both(UR, "actual_q_{k}", "target_q_{k}", UR_MOTORS),
        (OVERLAP, '[time."commander.csv"] offset_s = '),
    ),
    Case("rtde_two_clocks", "compare joined.toml", said=(OVERLAP, '[time."plan/log.csv"] offset_s = '), status=2),
    Case("sec_nanosec_clock", "init arm.xml log.csv", {"time": "sec + nanosec", **PLAIN}),
    Case("servo_gain_not_freed", "init servo.xml log.csv", said=('"actuator.servo.kp" = ',)),
    Case(
        "tick_ms",
        "init leg.xml lowstate_0.csv",
        {
            "time": "tick_ms [ms]",
            **{f"qpos.{joint}": f"{joint}_q_deg [deg]" for joint in LEG},
            **{f"ctrl.{motor}": f"{motor}_tau_cmd" for motor in LEGS},
        },
    ),
    Case("two_topic_files", "init arm.xml joint_states.csv commands.csv", PLAIN),
    Case("unit_degrees", "compare p.toml", said=("unit 'degrees' is unknown; nearest: deg\n",), status=2),
    Case("unmeasured_base_weld", "init dog.xml log.csv", PLAIN, ('[model_edit] weld = ["base"]',)),
    Case("ur5e_payload_friction", "init ur5e.xml log.csv", _both(UR, "actual_q_{k}", "target_q_{k}", UR_MOTORS)),
    Case(
        "urdf_no_actuator",
        "init model.xml log.csv",
        said=("the model has no actuator, the log has the command ctrl.motor: add <actuator><motor",),
    ),
)


def answer(case: Case, cases: Path, out: Path) -> Answer:
    """Run a case's command in this process; ``out`` is where it writes."""
    verb, *files = case.words.split()
    target = out / (f"{case.folder}.toml" if verb == "init" else f"{case.folder}-{verb}")
    printed = io.StringIO()
    before = processor_time()
    with (
        contextlib.chdir(cases / case.folder),
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(printed),
    ):
        status = command([verb, *files, "--out", str(target), *(["--force"] if verb == "init" else [])])
    seconds = processor_time() - before
    text = printed.getvalue()
    if verb == "init" and target.is_file():
        text += target.read_text(encoding="utf-8")
    lacking = [part for part in case.wanted if not any(way in text for way in part.split("|"))]
    return Answer(lacking, seconds, status)
