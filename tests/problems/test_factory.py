"""``model = "module:factory"``: what a factory may give, and from where it is run."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from onlinebayes.cli.main import main
from onlinebayes.parameters import Parameter
from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import DryFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.problems.conftest import PROBLEM


def write(folder: Path, text: str) -> Path:
    (folder / "carriage.toml").write_text(text)
    return folder / "carriage.toml"


WEDGE = "v 0 0 0\nv .3 0 0\nv 0 .2 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
GIVES = {
    "spec": "import mujoco\ndef make():\n    return mujoco.MjSpec.from_file('carriage.xml')\n",
    "root": "from dm_control import mjcf\ndef make():\n    return mjcf.from_path('carriage.xml')\n",
    "entity": """
from dm_control import composer, mjcf
class Carriage(composer.Entity):
    def _build(self):
        self._root = mjcf.from_path('carriage.xml')
    @property
    def mjcf_model(self):
        return self._root
def make():
    return Carriage()
""",
    "task": """
from dm_control import composer, mjcf
class Task(composer.Task):
    def __init__(self):
        self._root = composer.ModelWrapperEntity(mjcf.from_path('carriage.xml'))
    @property
    def root_entity(self):
        return self._root
    def get_reward(self, physics):
        return 0.0
def make():
    return Task()
""",
    "physics": "from dm_control import mujoco\ndef make():\n    return mujoco.Physics.from_xml_path('carriage.xml')\n",
    "bound": """
from dm_control import mjcf
def make():
    return mjcf.Physics.from_mjcf_model(mjcf.from_path('carriage.xml'))
""",
    "other": """
import mujoco
from dm_control import mujoco as dm
def make():
    physics = dm.Physics.from_xml_path('carriage.xml')
    mujoco.MjModel.from_xml_string('<mujoco><worldbody/></mujoco>')
    return physics
""",
}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("what", GIVES)
def test_what_a_factory_may_give(folder, monkeypatch, what):
    """A spec, or what dm_control builds; a compiled model whose XML MuJoCo no longer knows is refused."""
    pytest.importorskip("dm_control")
    monkeypatch.chdir(folder)
    (folder / f"gives_{what}.py").write_text(GIVES[what])
    text = PROBLEM.replace("carriage.xml", f"gives_{what}:make") + "[model_edit]\ntimestep = 0.0025\n"
    if what == "other":
        with pytest.raises(BadInput, match="compiled model whose XML is not known"):
            load_problem(write(folder, text))
        return
    simulator = load_problem(write(folder, text)).simulator
    assert isinstance(simulator, MujocoSimulator)
    assert simulator.timestep == 0.0025
    assert simulator.nominal.tolist() == [3.0, 2.0]
    simulator.with_effect(DryFriction("carriage", Parameter(0.0, 1.0, "N")))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("what", ["root", "physics", "bound"])
def test_a_mesh_that_only_dm_control_knows(folder, monkeypatch, what):
    """The files of a mjcf model are in memory, those of a compiled Physics nowhere."""
    pytest.importorskip("dm_control")
    monkeypatch.chdir(folder)
    (folder / "wedge.obj").write_text(WEDGE)
    asset = '<asset><mesh name="wedge" file="wedge.obj"/></asset><worldbody>'
    geom = '<geom name="wedge" type="mesh" mesh="wedge" mass="1"/></body>'
    model = (folder / "carriage.xml").read_text().replace("<worldbody>", asset).replace("</body>", geom)
    (folder / "carriage.xml").write_text(model)
    inertia = mujoco.MjModel.from_xml_path("carriage.xml").body("carriage").inertia
    (folder / f"meshed_{what}.py").write_text(GIVES[what])
    simulator = load_problem(write(folder, PROBLEM.replace("carriage.xml", f"meshed_{what}:make"))).simulator
    assert isinstance(simulator, MujocoSimulator)
    np.testing.assert_allclose(simulator.model.body("carriage").inertia, inertia, rtol=1e-5)
    simulator.with_effect(DryFriction("carriage", Parameter(0.0, 1.0, "N")))


def test_a_factory_beside_a_file_from_elsewhere_is_not_run(folder, monkeypatch, tmp_path_factory):
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    (folder / "beside.py").write_text("raise SystemExit('run')\n")
    with pytest.raises(BadInput, match="run the command in the folder that holds it"):
        load_problem(write(folder, PROBLEM.replace("carriage.xml", "beside:make")))


@pytest.mark.parametrize("command", ["compare", "next"])
@pytest.mark.parametrize(
    ("name", "text", "change", "message"),
    [
        ("ends", "import sys\nsys.exit(0)\n", ("carriage.xml", "ends:make"), "model: .*'ends' cannot .*SystemExit: 0"),
        (
            "stops",
            "import sys\ndef make():\n    sys.exit('no rig here')\n",
            ("carriage.xml", "stops:make"),
            "model: .*raised SystemExit: no rig here; mend the factory",
        ),
        (
            "refuses",
            "def __getattr__(name):\n    raise RuntimeError('no such thing')\n",
            ("carriage.xml", "refuses:make"),
            "model: .*'refuses:make' raised RuntimeError: no such thing; mend the factory",
        ),
        ("quits", "raise SystemExit(3)\n", None, "effects.modules: .*'quits' cannot be imported: SystemExit: 3"),
    ],
)
def test_user_code_that_raises_or_exits_is_bad_input(folder, monkeypatch, capsys, command, name, text, change, message):
    """It does not choose the exit status; 0 would say that a report was written."""
    monkeypatch.chdir(folder)
    (folder / f"{name}.py").write_text(text)
    write(folder, PROBLEM.replace(*change) if change else f"{PROBLEM}[effects]\nmodules = ['{name}']\n")
    assert main([command, "carriage.toml", "--out", "out"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(message, line)
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("[model_edit]\ntimestep = 0.001", "model_edit: the factory returns a simulator"),
        ("[actuators.motor]\ninput = 'force'", "actuators: the factory returns a simulator"),
        ('"joint.*.stiffness" = [0, 1]', "a glob needs the model's names"),
    ],
)
def test_what_needs_a_spec(folder, monkeypatch, more, message):
    monkeypatch.chdir(folder)
    (folder / "built.py").write_text(
        "from onlinebayes.simulators.mujoco import MujocoSimulator\n"
        "from onlinebayes.parameters import ParameterSpace\n"
        "def make(space):\n"
        "    return MujocoSimulator('carriage.xml', ParameterSpace({k: v for k, v in space.items() if '*' not in k}))\n"
    )
    with pytest.raises(BadInput, match=message):
        load_problem(write(folder, PROBLEM.replace("carriage.xml", "built:make") + more))


PUSHED = """
from onlinebayes.simulators.mujoco import MujocoSimulator
def mujoco(parameters):
    return MujocoSimulator("carriage.xml", parameters, dt=0.01)
class Foreign(MujocoSimulator):
    def with_columns(self, columns):
        return self
def foreign(parameters):
    return Foreign("carriage.xml", parameters)
"""


def test_a_push_is_not_dropped_where_a_factory_gives_the_simulator(folder, monkeypatch):
    """Nor are a torque and a sensor; a simulator without an input for a push is refused."""
    monkeypatch.chdir(folder)
    (folder / "pushed.py").write_text(PUSHED)
    head, *rows = (folder / "carriage.csv").read_text().splitlines()
    table = "\n".join([f"{head},xfrc.carriage.0,qfrc.carriage", *(f"{row},1,0.5" for row in rows)])
    (folder / "carriage.csv").write_text(table + "\n")
    problem = load_problem(write(folder, PROBLEM.replace("carriage.xml", "pushed:mujoco")))
    assert problem.simulator.commands == ("motor", "xfrc.carriage.0")
    assert problem.simulator.signals[-1] == "qfrc.carriage"
    assert problem.simulator.dt == 0.01
    assert problem.measurement.data["command"][..., 1].max() == 1.0
    with pytest.raises(BadInput, match=r"no input for a measured push called 'xfrc.carriage.0'; .*'ignore'"):
        load_problem(write(folder, PROBLEM.replace("carriage.xml", "pushed:foreign")))
    ignoring = 'ignore = ["xfrc.*"]\n' + PROBLEM.replace("carriage.xml", "pushed:foreign")
    assert load_problem(write(folder, ignoring)).simulator.commands == ("motor",)
