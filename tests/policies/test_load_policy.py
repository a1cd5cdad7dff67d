"""A policy out of its file acts as torch's does, and says in one line what it cannot do."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn

import onlinebayes
from onlinebayes.objectives import exported, save_policy
from onlinebayes.policies import Origin, PolicyCard
from onlinebayes.runs import BadInput, write_arrays
from tests.policies.policies import KEYS, acted, make, observations

pytest.importorskip("safetensors")

CHANNELS = {
    "observation": {"angle": "rad", "rate": "rad/s", "x": "m", "y": "m", "z": "m"},
    "desired_goal": {"goal x": "m", "goal y": "m"},
    "action": {"push": "N", "pull": "N"},
}
UNNAMED = Origin("task", {})
ORIGIN = Origin("Reaching", CHANNELS, 0.04, "DDPG", "worlds of the prior", 3000, -12.5, "reach")


def saved(kind: str, folder: Path, origin: Origin = UNNAMED):
    objective = make(kind)
    save_policy(folder, objective.policy, origin)
    return objective.policy, onlinebayes.load_policy(folder)


@pytest.mark.parametrize("kind", ["ppo", "sac", "ddpg", "one-hot", "index"])
def test_it_acts_as_the_torch_policy_does(kind: str, tmp_path: Path) -> None:
    policy, loaded = saved(kind, tmp_path)
    data = observations(200)
    wanted = acted(policy, data)
    keys = KEYS if kind == "ddpg" else KEYS[:1]
    rows = torch.cat([data[key] for key in keys], -1).numpy()
    each = np.stack([loaded.act(row) for row in rows])
    assert each.shape == wanted.shape
    assert len(np.unique(wanted.round(3), axis=0)) > 2, "it acts alike whatever it sees"
    np.testing.assert_allclose(each, wanted, rtol=0, atol=1e-6 * 4)  # of bounds up to 4
    np.testing.assert_allclose(loaded.act(rows), each, rtol=0, atol=1e-6 * 4)
    first = {key: data[key][0].numpy() for key in KEYS}
    np.testing.assert_array_equal(loaded.act(first), each[0])


def test_a_recurrent_policy_remembers_until_it_is_reset(tmp_path: Path) -> None:
    policy, loaded = saved("recurrent", tmp_path)
    assert loaded.card.recurrent
    rows = observations(12)
    memory = torch.zeros(2, 16)
    for k, row in enumerate(rows):
        begins = k in (0, 7)
        if k == 7:
            loaded.reset()
        data = row.select("observation").set("is_init", torch.tensor([begins])).set("memory", memory)
        with torch.no_grad():
            wanted = acted(policy, data)
            memory = policy(data.clone())["next", "memory"]
        np.testing.assert_allclose(loaded.act(row["observation"].numpy()), wanted, rtol=0, atol=4e-6)
    with pytest.raises(BadInput, match=r"shape \(2, 5\), the policy sees \(5,\)"):
        loaded.act(np.zeros((2, 5)))


@pytest.mark.parametrize("activation", [nn.ELU, nn.LeakyReLU, nn.Sigmoid, nn.SiLU])
def test_other_activations_and_plain_actors(activation: type[nn.Module], tmp_path: Path) -> None:
    body = nn.Sequential(nn.Linear(5, 8), activation(), nn.Linear(8, 2, bias=False))
    actor = TensorDictModule(body, ["observation"], ["action"])
    save_policy(tmp_path, actor, UNNAMED)
    data = observations(50)
    found = onlinebayes.load_policy(tmp_path).act(data["observation"].numpy())
    np.testing.assert_allclose(found, acted(actor, data), rtol=1e-5, atol=1e-6)


def test_names_stand_for_columns(tmp_path: Path) -> None:
    _, loaded = saved("ddpg", tmp_path, ORIGIN)
    row = np.array([0.1, -0.2, 0.3, 0.4, 0.5, 1.0, -1.0])
    told = dict(zip([channel.name for channel in loaded.card.observation], row, strict=True))
    np.testing.assert_array_equal(loaded.act(dict(reversed(told.items()))), loaded.act(row))
    with pytest.raises(BadInput, match="the observation has no 'goal x'; nearest: goal_x"):
        loaded.act({("goal_x" if name == "goal x" else name): value for name, value in told.items()})
    with pytest.raises(BadInput, match=r"shape \(6,\), the policy sees \(7,\); give, in this order: angle \[rad\]"):
        loaded.act(row[:6])
    with pytest.raises(BadInput, match="NaN or infinite in 'rate', 'goal y'; look at that sensor"):
        loaded.act(np.where([0, 1, 0, 0, 0, 0, 1], np.nan, row))
    large = np.full(7, 3e38, dtype=np.float32)
    with np.errstate(over="ignore"):
        assert np.isfinite(loaded.act(large)).all(), "a sum that overflows is no NaN"


def test_the_card_says_what_it_sees_and_does(tmp_path: Path) -> None:
    _, loaded = saved("ddpg", tmp_path, ORIGIN)
    card = loaded.card
    assert card.origin == ORIGIN
    assert [(each.name, each.unit, each.key) for each in card.observation][-1] == ("goal y", "m", "desired_goal")
    assert [(each.name, each.unit, each.low, each.high) for each in card.action] == [
        ("push", "N", -2.0, 2.0),
        ("pull", "N", 0.5, 4.0),
    ]
    assert card.version == onlinebayes.__version__
    text = (tmp_path / "policy.md").read_text(encoding="utf-8")
    for words in (
        "Reaching",
        "worlds of the prior",
        "| -12.5 |",
        "0.04 s",
        "| angle | rad |",
        "| pull | N | 0.5 | 4 |",
    ):
        assert words in text
    assert PolicyCard.from_plain(json.loads(json.dumps(card.to_plain()))) == card


def test_columns_that_a_transform_has_added_get_numbers(tmp_path: Path) -> None:
    _, loaded = saved("ddpg", tmp_path, Origin("task", {**CHANNELS, "observation": {"angle": "rad"}}))
    names = [channel.name for channel in loaded.card.observation]
    assert names == [*(f"observation.{k}" for k in range(5)), "goal x", "goal y"]


def test_columns_of_one_name_are_told_apart_by_their_arrays(tmp_path: Path) -> None:
    alike = {"observation": dict.fromkeys("abcde", "m"), "desired_goal": dict.fromkeys("ab", "m")}
    _, loaded = saved("ddpg", tmp_path, Origin("task", alike))
    assert [channel.name for channel in loaded.card.observation][-2:] == ["desired_goal a", "desired_goal b"]


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (nn.Sequential(nn.Linear(5, 4), nn.LayerNorm(4), nn.Linear(4, 2)), "LayerNorm"),
        (nn.Sequential(nn.Linear(5, 4), nn.ELU(alpha=0.5), nn.Linear(4, 2)), r"ELU\(alpha=0.5\)"),
        (nn.LSTM(5, 2), "LSTM"),
    ],
)
def test_what_cannot_be_exported_is_named(body: nn.Module, said: str) -> None:
    with pytest.raises(BadInput, match=f"a policy with {said} cannot be exported; what can: linear layers"):
        exported(TensorDictModule(body, ["observation"], ["action"]))


def test_a_policy_of_no_network_is_refused() -> None:
    class Planner(nn.Module):
        def forward(self, data: TensorDict) -> TensorDict:
            return data

    with pytest.raises(BadInput, match="a policy with Planner cannot be exported"):
        exported(Planner())


DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty": (lambda path: path.write_bytes(b""), "is cut off, damaged or of another kind"),
    "half": (lambda path: path.write_bytes(path.read_bytes()[:2000]), "is cut off, damaged or of another kind"),
    "text": (lambda path: path.write_text("weight,bias\n1,2\n"), "is cut off, damaged or of another kind"),
    "a changed byte": (
        lambda path: path.write_bytes(path.read_bytes()[:-3] + b"\x00" + path.read_bytes()[-2:]),
        "is damaged: its checksum is another",
    ),
    "arrays of something else": (
        lambda path: write_arrays(path, "other thing", {"a": np.zeros(2)}, {}),
        "holds no onlinebayes policy",
    ),
    "no network": (
        lambda path: write_arrays(path, "onlinebayes policy", {"a": np.zeros(2)}, {"network": {}, "card": {}}),
        "is damaged: 'inputs'",
    ),
    "removed": (lambda path: path.unlink(), "holds no policy.safetensors; give the folder of a training run"),
}


@pytest.mark.parametrize(("spoil", "said"), DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_file_is_one_clear_line(tmp_path: Path, spoil: Callable[[Path], object], said: str) -> None:
    save_policy(tmp_path, make("sac").policy, UNNAMED)
    spoil(tmp_path / "policy.safetensors")
    with pytest.raises(BadInput, match=said) as caught:
        onlinebayes.load_policy(tmp_path)
    assert str(tmp_path) in str(caught.value)
    assert "; " in str(caught.value), "no cure"
    assert "\n" not in str(caught.value)


def test_a_folder_that_is_not_there_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="nowhere: there is no such file"):
        onlinebayes.load_policy(tmp_path / "nowhere")


def test_loading_needs_neither_torchrl_nor_mujoco(tmp_path: Path) -> None:
    saved("sac", tmp_path)
    shutil.move(tmp_path / "policy.safetensors", tmp_path / "elsewhere.safetensors")  # the file alone is enough
    code = (
        "import sys, onlinebayes; policy = onlinebayes.load_policy(sys.argv[1]); policy.act([0, 0, 0, 0, 0]);"
        "sys.exit(bool({'torchrl', 'mujoco', 'scipy'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "elsewhere.safetensors")]
    assert subprocess.run(command, check=False).returncode == 0
