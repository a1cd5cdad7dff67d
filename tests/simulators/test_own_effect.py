"""The example of the documentation: an effect of a user's own, imported as a problem file's module."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter
from onlinebayes.problems import import_module
from onlinebayes.simulators.effects import EFFECTS, Effect, Scales
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_effect
from tests.simulators.models import SLIDE

DOCUMENT = Path(__file__).parents[2] / "docs" / "concepts" / "effects.md"


@pytest.fixture
def propeller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    blocks = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    code = next(block for block in blocks if "PropellerTorque" in block)
    (tmp_path / "my_propeller.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    import_module("my_propeller")
    yield EFFECTS["propeller_torque"]
    EFFECTS.pop("propeller_torque")
    sys.modules.pop("my_propeller")


def test_the_documented_effect_keeps_the_contract(propeller: type[Effect]) -> None:
    check_effect(MujocoSimulator(SLIDE), propeller.scaled("rail", Scales(3.0, 2.0, 1.5, 0.05)))


def test_the_documented_effect_pushes_with_the_square_of_the_command(propeller: type[Effect]) -> None:
    simulator = MujocoSimulator(SLIDE).with_effect(propeller("rail", Parameter(-1.0, 1.0)))  # type: ignore[call-arg]
    simulator.reset(torch.tensor([[0.25]]).double())
    after = simulator.step(TensorDict({"command": torch.tensor([[-3.0]]).double()}, batch_size=[1]))
    assert float(after["qvel"]) == pytest.approx(0.002 * (-3.0 - 0.25 * 9.0) / 2.0, rel=1e-12)
