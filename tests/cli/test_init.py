"""A first problem file: columns matched, parameters that the log tells apart, nothing overwritten."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest

from onlinebayes.cli.main import main
from onlinebayes.parameters import ParameterSpace
from onlinebayes.problems import load_problem
from onlinebayes.problems.drafting.first_draft import draft
from onlinebayes.problems.drafting.freeing import free_parameters
from tests.criticism import tumbling
from tests.identification.fitting.test_unmeasured_moments import HANGING, LINK, TURNTABLE, recorded
from tests.problems.conftest import MODEL, table
from tests.simulators.linkages import GRIPPER


def make(folder, capsys, *more: str, log: str = "carriage.csv", out: str = "first.toml") -> tuple[int, str]:
    status = main(["init", str(folder / "carriage.xml"), str(folder / log), "--out", str(folder / out), *more])
    return status, "".join(capsys.readouterr())


def test_exact_names_need_nothing_more(folder, capsys) -> None:
    status, said = make(folder, capsys)
    assert status == 0
    assert "missing" not in said
    problem = load_problem(folder / "first.toml")
    assert problem.holdout == ("second",)
    assert problem.simulator.parameters.names == ("joint.carriage.damping", "body.carriage.mass")
    content = tomllib.loads((folder / "first.toml").read_text())
    assert content["parameters"] == {"joint.carriage.damping": [0.0, 6.0], "body.carriage.mass": [1.0, 9.0]}
    assert "signals" not in content


def test_commands_and_positions_in_two_tables_of_the_same_runs(folder, capsys) -> None:
    """Commands every 10 ms and positions every 20 ms are what one table with empty cells is."""
    rows = [row.split(",") for row in (folder / "carriage.csv").read_text().splitlines()]
    sent = [f"{run},{t},{u}" for run, t, u, _ in rows]
    seen = [f"{run},{t},{q}" for k, (run, t, _, q) in enumerate(rows) if k == 0 or t[-1] in "02468"]
    (folder / "sent.csv").write_text("\n".join(sent))
    (folder / "seen.csv").write_text("\n".join(seen))
    empty = [f"{run},{t},{u},{q if k == 0 or t[-1] in '02468' else ''}" for k, (run, t, u, q) in enumerate(rows)]
    (folder / "carriage.csv").write_text("\n".join(empty))
    model, *logs = (str(folder / name) for name in ("carriage.xml", "sent.csv", "seen.csv"))
    assert main(["init", model, *logs, "--out", str(folder / "first.toml")]) == 0
    assert "missing" not in "".join(capsys.readouterr())
    assert tomllib.loads((folder / "first.toml").read_text())["measurements"] == ["sent.csv", "seen.csv"]
    notes: list[str] = []
    joined = load_problem(folder / "first.toml", note=notes.append).measurement
    assert bool((joined.data == load_problem(folder / "carriage.toml").measurement.data).all())
    assert any("joined by 'time'" in note for note in notes)


def test_a_position_is_not_missed_where_the_speed_was_measured(folder, capsys) -> None:
    rows = [row.split(",") for row in (folder / "carriage.csv").read_text().splitlines()[1:]]
    speeds = [(float(b[3]) - float(a[3])) / 0.01 for a, b in zip(rows, [*rows[1:], rows[-1]], strict=True)]
    text = [f"{run},{t},{u},{v:.6f}" for (run, t, u, _), v in zip(rows, speeds, strict=True)]
    (folder / "speeds.csv").write_text("\n".join(["run,time,ctrl.motor,qvel.carriage", *text]))
    status, said = make(folder, capsys, log="speeds.csv")
    assert status == 0
    assert "missing" not in said
    assert load_problem(folder / "first.toml").simulator.parameters.names[0] == "joint.carriage.damping"


def test_the_file_is_called_like_the_model_by_default(folder, capsys, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    (folder / "cart.xml").write_text(MODEL)
    assert main(["init", "cart.xml", "carriage.csv"]) == 0
    assert "wrote:     cart.toml" in capsys.readouterr().out
    assert load_problem(folder / "cart.toml").holdout == ("second",)


def test_a_gear_is_freed_only_where_mass_and_damping_do_not_do_the_same(folder) -> None:
    """m v' = g u - d v knows two of three; with the mass at rest in the model's frame both joints share one gear."""
    assert "gear" not in draft(folder / "carriage.xml", [folder / "carriage.csv"], folder / "x.toml").text
    fixed = MODEL.replace('damping="2"', 'damping="2" armature="0.5"').replace("mass=", "density='0' mass=")
    (folder / "carriage.xml").write_text(fixed)
    text = draft(folder / "carriage.xml", [folder / "carriage.csv"], folder / "x.toml").text
    assert "armature" not in text


def test_a_damping_of_zero_is_bounded_by_what_the_log_shows(folder) -> None:
    (folder / "carriage.xml").write_text(MODEL.replace(' damping="2"', ""))
    text = draft(folder / "carriage.xml", [folder / "carriage.csv"], folder / "x.toml").text
    low, high = tomllib.loads(text)["parameters"]["joint.carriage.damping"]
    assert low == 0.0
    assert 2.0 < high < 200.0


def test_a_free_body_has_its_mass_and_the_moments_of_inertia_that_the_log_tells_and_no_damping() -> None:
    """No torque acts on the block: its moments of inertia have ratios only, two numbers for three."""
    proposed = free_parameters(tumbling.model(ParameterSpace({})), tumbling.measure(tumbling.Block(), runs=3))
    assert proposed.names == ("body.block.mass", "body.block.inertia[0]", "body.block.inertia[1]")
    assert (proposed["body.block.mass"].low, proposed["body.block.mass"].high) == (0.667, 6.0)


def test_near_names_are_proposed_with_their_unit(folder, capsys) -> None:
    rows = table().replace("qpos.carriage", "Position_mm").splitlines()
    scaled = [",".join([*row.split(",")[:3], str(1e3 * float(row.split(",")[3]))]) for row in rows[1:]]
    (folder / "lab.csv").write_text("\n".join([rows[0], *scaled]) + "\n")
    status, said = make(folder, capsys, log="lab.csv")
    assert status == 0
    assert "qpos.carriage <- Position_mm [mm]" in said
    tomllib.loads((folder / "first.toml").read_text().replace("# [", "["))  # no table is begun a second time
    loaded = load_problem(folder / "first.toml").measurement.data["signal"]
    own = load_problem(folder / "carriage.toml").measurement.data["signal"]
    assert float((loaded - own).abs().max()) < 1e-9


@pytest.mark.parametrize(
    ("column", "unit", "ticks"),
    [("t_ms", "ms", 1e3), ("timestamp", "ns", 1e9), ("Elapsed", "ms", 1e3), ("Time [s]", "s", 1.0)],
)
def test_a_clock_of_another_name_is_proposed_with_its_unit(
    folder, capsys, column: str, unit: str, ticks: float
) -> None:
    """From the column's name, or where that has none from its step: 10 ms here."""
    head, *rows = [row.split(",") for row in table().splitlines()]
    text = [",".join([run, repr(float(t) * ticks), *rest]) for run, t, *rest in rows]
    (folder / "lab.csv").write_text("\n".join([",".join([head[0], column, *head[2:]]), *text]) + "\n")
    status, said = make(folder, capsys, log="lab.csv")
    assert status == 0
    assert f"time <- {column} [{unit}]" in said
    assert tomllib.loads((folder / "first.toml").read_text())["time"] == {"column": column, "unit": unit}
    loaded = load_problem(folder / "first.toml").measurement.data["time"]
    own = load_problem(folder / "carriage.toml").measurement.data["time"]
    assert float((loaded - own).abs().max()) < 1e-9


def test_two_clocks_are_a_question(folder, capsys) -> None:
    text = table().replace("run,time", "run,t").splitlines()
    (folder / "lab.csv").write_text("\n".join([f"{text[0]},stamp", *(f"{row},0" for row in text[1:])]) + "\n")
    _, said = make(folder, capsys, log="lab.csv")
    assert 'missing:   time: perhaps t; name it here: [time] column = "..."' in said


def test_a_clock_of_an_unknown_word_is_the_column_that_rises(folder, capsys) -> None:
    (folder / "lab.csv").write_text(table().replace("run,time", "run,Zeit"))
    _, said = make(folder, capsys, log="lab.csv")
    assert 'missing:   time: perhaps Zeit; name it here: [time] column = "...", unit = "ms"' in said


def test_a_mapped_command_tells_parameters_apart_as_its_own_name_does(folder, capsys) -> None:
    (folder / "lab.csv").write_text(table().replace("ctrl.motor", "motor_effort"))
    status, said = make(folder, capsys, log="lab.csv")
    assert status == 0
    assert "ctrl.motor <- motor_effort" in said
    problem = load_problem(folder / "first.toml")
    assert problem.simulator.parameters.names == ("joint.carriage.damping", "body.carriage.mass")
    own = load_problem(folder / "carriage.toml").measurement.data
    assert bool((problem.measurement.data["command"] == own["command"]).all())


def test_logs_of_other_formats_are_read(folder, capsys) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows = [row.split(",") for row in table().splitlines()]
    columns = {name: [row[k] if name == "run" else float(row[k]) for row in rows[1:]] for k, name in enumerate(rows[0])}
    pq.write_table(pa.table(columns), folder / "lab.parquet")
    status, _ = make(folder, capsys, log="lab.parquet")
    assert status == 0
    problem = load_problem(folder / "first.toml")
    assert problem.holdout == ("second",)
    assert problem.simulator.parameters.names == ("joint.carriage.damping", "body.carriage.mass")


def test_a_measured_joint_torque_is_no_foreign_column(folder, capsys) -> None:
    (folder / "carriage.csv").write_text(
        "\n".join(f"{row},{'qfrc.carriage' if k == 0 else '0.1'}" for k, row in enumerate(table().splitlines())) + "\n"
    )
    make(folder, capsys)
    signals = load_problem(folder / "first.toml").measurement.signals
    assert [signal.name for signal in signals] == ["qpos.carriage", "qfrc.carriage"]


def test_what_cannot_be_matched_is_named(folder, capsys) -> None:
    (folder / "lab.csv").write_text(table().replace("qpos.carriage", "channel 7"))
    status, said = make(folder, capsys, log="lab.csv")
    assert status == 0
    assert "missing:   qpos.carriage" in said
    assert "unused:    channel 7" in said
    text = (folder / "first.toml").read_text()
    assert "# MISSING: qpos.carriage" in text
    assert tomllib.loads(text)["parameters"]


@pytest.mark.parametrize("log", ["carriage.toml", "notes.txt", "carriage.xml"])
def test_a_text_that_is_no_log_of_the_model_makes_no_problem_file(folder, capsys, log: str) -> None:
    """Any text has a first line; here nothing in it is the model's, and nothing a clock."""
    (folder / "notes.txt").write_text("\n".join(f"note {k}" for k in range(12)))
    status, said = make(folder, capsys, log=log)
    assert status == 2
    assert said.count("\n") == 1
    assert f"{log}" in said
    assert not (folder / "first.toml").exists()


def test_a_log_of_another_machine_is_named_by_its_columns(folder, capsys) -> None:
    (folder / "lab.csv").write_text(",".join(f"c{k}" for k in range(9)) + "\n" + ",".join("1" * 9) + "\n")
    status, said = make(folder, capsys, log="lab.csv")
    assert status == 2
    assert "lab.csv: no column is one of the model's, and none a clock; the model has 'qpos.carriage'" in said
    assert "the log has 'c0', 'c1', 'c2', 'c3', 'c4', 'c5' and 3 more; write a problem file that maps them" in said
    assert '[time] column = "...", [signals."qpos.carriage"] column = "..."' in said


@pytest.mark.parametrize(
    ("head", "row", "message"),
    [
        ("time,ctrl.motor,channel 7", "0.02,1", "row 4: 2 cells where the header has 3"),
        ("t,Position_mm", "0.02,far", "row 4, column 'Position_mm': 'far' is not a number"),
        ("time,channel 7", "noon,1", "row 4, column 'time': 'noon' is not a number"),
    ],
)
def test_malformed_rows_are_met_where_columns_are_missing_too(folder, capsys, head, row, message) -> None:
    cells = [",".join([f"0.0{k}", *"0" * head.count(",")]) for k in range(2)]
    (folder / "lab.csv").write_text("\n".join([head, *cells, row]) + "\n")
    status, said = make(folder, capsys, log="lab.csv")
    assert status == 2
    assert f"lab.csv, {message}" in said
    assert not (folder / "first.toml").exists()


def test_foreign_columns_that_look_like_the_models_are_ignored(folder, capsys) -> None:
    (folder / "carriage.csv").write_text(
        "\n".join(f"{row},{'qpos.wheel' if k == 0 else '0.1'}" for k, row in enumerate(table().splitlines())) + "\n"
    )
    make(folder, capsys)
    assert load_problem(folder / "first.toml").measurement.signals[0].name == "qpos.carriage"


WRITES_TOML = 't\n[effects]\nmodules = ["stranger"]\n\x1b[31m#'


@pytest.mark.parametrize("place", ["clock", "column", "joint"])
def test_a_name_stays_a_name(folder, capsys, place: str) -> None:
    """A column or a joint whose name is a table of TOML adds none to the file: modules named there would be run."""
    table, model = folder / "carriage.csv", folder / "carriage.xml"
    cell = '"' + WRITES_TOML.replace('"', '""') + '"'
    if place == "joint":
        name = WRITES_TOML.replace("\n", "&#10;").replace('"', "&quot;").replace("\x1b", "")
        text = MODEL.replace('joint name="carriage"', f'joint name="{name}"')
        model.write_text(text.replace('joint="carriage"', f'joint="{name}"'))
    else:
        old = "time," if place == "clock" else "qpos.carriage"
        table.write_text(table.read_text().replace(old, cell + ("," if place == "clock" else ""), 1))
    status, said = make(folder, capsys)
    assert "\x1b" not in said
    if status == 0:
        content = tomllib.loads((folder / "first.toml").read_text())
        assert "effects" not in content
        words = ("onlinebayes: asking", "matched:", "missing:", "unused:", "wrote:")
        assert all(line.startswith(words) for line in said.splitlines())
    assert status in (0, 2)


def test_many_columns_alike_are_said_in_one_line(tmp_path, capsys) -> None:
    count = 10
    link = '<body pos=".2 0 0"><joint name="j{0}" axis="0 1 0"/><geom size=".05"/>{1}</body>'
    tree = ""
    for k in reversed(range(count)):
        tree = link.format(k, tree)
    motors = "".join(f'<motor name="m{k}" joint="j{k}"/>' for k in range(count))
    text = f"<mujoco><worldbody>{tree}</worldbody><actuator>{motors}</actuator></mujoco>"
    (tmp_path / "arm.xml").write_text(text)
    header = ",".join(["time", *(f"q_{k}" for k in range(count)), *(f"tau_{k}" for k in range(count))])
    rows = "\n".join(f"{0.01 * row}" + ",0" * 2 * count for row in range(50))
    (tmp_path / "log.csv").write_text(f"{header}\n{rows}\n")
    arguments = ["init", str(tmp_path / "arm.xml"), str(tmp_path / "log.csv"), "--out", str(tmp_path / "p.toml")]
    assert main(arguments) == 0
    matched = [line for line in capsys.readouterr().out.splitlines() if line.startswith("matched:")]
    assert len(matched) == 2
    assert "qpos.j0 to qpos.j9 <- q_0 to q_9" in matched[0]


def test_a_link_is_not_written_through(folder, capsys) -> None:
    (folder / "first.toml").symlink_to(folder / "other.toml")
    for more in ((), ("--force",)):
        status, said = make(folder, capsys, *more)
        assert status == 2
        assert "is a link to" in said
    assert not (folder / "other.toml").exists()
    assert (folder / "first.toml").is_symlink()


def test_a_folder_is_not_a_file(folder, capsys) -> None:
    (folder / "first.toml").mkdir()
    status, said = make(folder, capsys, "--force")
    assert status == 2
    assert "is a folder; give the name of a file" in said


def test_a_file_that_is_there_stays(folder, capsys) -> None:
    before = (folder / "carriage.toml").read_text()
    status, said = make(folder, capsys, out="carriage.toml")
    assert status == 2
    assert "--force" in said
    assert (folder / "carriage.toml").read_text() == before
    status, _ = make(folder, capsys, "--force", out="carriage.toml")
    assert status == 0
    assert (folder / "carriage.toml").read_text() != before


@pytest.mark.parametrize("column", ["motor", "channel 7"])
def test_a_guess_of_a_command_is_called_one(folder, capsys, column: str) -> None:
    (folder / "lab.csv").write_text(table().replace("ctrl.motor", column))
    status, said = make(folder, capsys, log="lab.csv")
    assert status == 0
    assert f"ctrl.motor <- {column}   (a guess, " in said
    assert "missing" not in said
    assert "unused" not in said
    (line,) = [line for line in (folder / "first.toml").read_text().splitlines() if line.startswith("column")]
    assert "# a guess, " in line
    own = load_problem(folder / "carriage.toml").measurement.data["command"]
    assert bool((load_problem(folder / "first.toml").measurement.data["command"] == own).all())


@pytest.mark.parametrize(("column", "unit"), [("stage_um", "um"), ("Weg [mm]", "mm")])
def test_the_last_column_of_a_position_is_guessed_for_the_last_joint(folder, capsys, column: str, unit: str) -> None:
    factor = {"mm": 1e3, "um": 1e6}[unit]
    head, *rows = (row.rpartition(",") for row in table().splitlines())
    scaled = [f"{row[0]},{factor * float(row[2])!r},0" for row in rows]
    (folder / "lab.csv").write_text("\n".join([f"{head[0]},{column},temperature", *scaled]))
    status, said = make(folder, capsys, log="lab.csv")
    assert status == 0
    assert f"qpos.carriage <- {column} [{unit}]   (a guess, no other column is left: check" in said
    own = load_problem(folder / "carriage.toml").measurement.data["signal"]
    assert np.allclose(load_problem(folder / "first.toml").measurement.data["signal"], own, atol=1e-9)


def test_several_positions_are_a_question(folder, capsys) -> None:
    head, *rows = table().replace("qpos.carriage", "stage_um").splitlines()
    (folder / "lab.csv").write_text("\n".join([f"{head},frame_mm", *(f"{row},0" for row in rows)]))
    _, said = make(folder, capsys, log="lab.csv")
    assert "missing:   qpos.carriage: stage_um or frame_mm could be it" in said


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("channel 8", "channel 7 or channel 8 could be it"),
        ("note", ""),  # text
        ("temperature", ""),  # tells no actuator anything
        ("wheel position", ""),
    ],
)
def test_the_last_column_is_guessed_only_where_no_other_could_be_it(folder, capsys, more: str, said: str) -> None:
    head, *rows = table().replace("ctrl.motor", "channel 7").splitlines()
    cell = "fine" if more == "note" else "0.1"
    (folder / "lab.csv").write_text("\n".join([f"{head},{more}", *(f"{row},{cell}" for row in rows)]) + "\n")
    status, printed = make(folder, capsys, log="lab.csv")
    assert status == 0
    text = (folder / "first.toml").read_text()
    assert tomllib.loads(text)["parameters"]
    if said:
        assert f"missing:   ctrl.motor: {said}; name it here: [commands.motor]" in printed
        assert f"# MISSING: ctrl.motor: {said}; name it here" in text
    else:
        assert "ctrl.motor <- channel 7" in printed
        assert f"unused:    {more}" in printed


def test_a_commands_unit_is_read_as_the_problem_file_does(folder, capsys) -> None:
    (folder / "lab.csv").write_text(table().replace("ctrl.motor", "motor_force_mN"))
    status, said = make(folder, capsys, log="lab.csv")
    assert status == 0
    assert "ctrl.motor <- motor_force_mN [mN]" in said
    own = load_problem(folder / "carriage.toml").measurement.data["command"]
    assert float((load_problem(folder / "first.toml").measurement.data["command"] - 1e-3 * own).abs().max()) < 1e-12


@pytest.mark.parametrize(("where", "freed"), [(HANGING, "body.link.mass"), (TURNTABLE, "body.link.inertia[")])
def test_no_gear_is_freed_beside_a_mass_and_no_mass_beside_its_moment(tmp_path, where, freed) -> None:
    """A gear beside a mass leaves but ratios; about a vertical axis one number shows, the moment of inertia."""
    (tmp_path / "link.xml").write_text(LINK.format(**where, mass=0.5))
    data, logs = recorded(where, 0.8).data, []
    for r in range(len(data)):
        rows = zip(*(data[key][r].flatten().tolist() for key in ("time", "command", "signal")), strict=True)
        logs.append(tmp_path / f"run{r}.csv")
        logs[-1].write_text("time,ctrl.motor,qpos.hinge\n" + "\n".join(f"{t},{u},{q}" for t, u, q in rows) + "\n")
    text = draft(tmp_path / "link.xml", logs, tmp_path / "x.toml").text
    parameters = text[text.index("[parameters]") :].split("\n\n")[0]
    assert freed in parameters
    assert "gear" not in parameters
    assert ("body.link.mass" in parameters) == (where is HANGING)


def test_a_finger_that_is_geared_to_the_other_is_not_missed(folder, capsys) -> None:
    """Nor are its damping and mass freed, of which nothing tells the other finger's."""
    (folder / "gripper.xml").write_text(GRIPPER)
    rows = [f"a,{0.01 * k},{math.sin(0.1 * k):.4f},{0.02 * math.sin(0.1 * k - 1):.6f}" for k in range(600)]
    (folder / "grasp.csv").write_text("\n".join(["run,time,ctrl.motor,qpos.left", *rows]))
    out = str(folder / "first.toml")
    assert main(["init", str(folder / "gripper.xml"), str(folder / "grasp.csv"), "--out", out]) == 0
    said = capsys.readouterr().out
    assert "follows:   qpos.right, from the others by the model's <equality>" in said
    assert "missing" not in said
    notes: list[str] = []
    problem = load_problem(out, note=notes.append)
    assert any("worked out" in note and note.endswith("qpos.right") for note in notes)
    assert [signal.name for signal in problem.measurement.signals if "qpos" in signal.name] == [
        "qpos.left",
        "qpos.right",
    ]
    assert not any("right" in name for name in problem.simulator.parameters)


def test_a_unit_of_another_quantity_is_not_proposed(folder, capsys) -> None:
    table = folder / "carriage.csv"
    table.write_text(table.read_text().replace("qpos.carriage", "carriage_pos_deg"))
    status, said = make(folder, capsys)
    assert status == 0
    assert "carriage_pos_deg" not in said.split("missing:")[0]
    assert "qpos.carriage" in said.split("missing:")[1]


def test_a_clock_called_time_in_milliseconds_is_read_so(folder, capsys) -> None:
    table = folder / "carriage.csv"
    head, *rows = table.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    table.write_text("\n".join([head, *(",".join([r, str(1e3 * float(t)), *rest]) for r, t, *rest in cells)]) + "\n")
    status, said = make(folder, capsys)
    assert status == 0
    assert "time <- time [ms]" in said
    assert len(load_problem(folder / "first.toml").measurement.runs) == 2


def test_columns_that_say_as_much_are_named(folder, capsys) -> None:
    head, *rows = table().replace("ctrl.motor", "motor_A").splitlines()
    (folder / "lab.csv").write_text("\n".join([f"{head},motor_current", *(f"{row},0" for row in rows)]) + "\n")
    _, said = make(folder, capsys, log="lab.csv")
    assert "missing:   ctrl.motor: motor_A or motor_current could be it; name it here" in said
