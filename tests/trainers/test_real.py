"""Real systems: a folder of logs that grows, one that runs beside the learning, and what is refused of either."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.data import Composite, Unbounded
from torchrl.envs import EnvBase

from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.runs import BadInput
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.trainers import (
    Background,
    Excited,
    GrowingFolder,
    RealEnvironment,
    RealSystem,
    SystemFailed,
    TrajectoryFormat,
    real,
)
from onlinebayes.trainers.real import measured, united

POLICY = TensorDictModule(nn.Identity(), ["observation"], ["action"])


def read(path: Path) -> TensorDict:
    """A log is a line of numbers; each is an observation."""
    numbers = torch.tensor([float(word) for word in path.read_text().split()])
    path_of = {"observation": numbers[:, None], "action": numbers[:, None], "next": {"observation": numbers[:, None]}}
    return TensorDict(path_of, batch_size=[len(numbers)])


def test_a_folder_gives_each_log_once_padded_to_one_length(tmp_path: Path) -> None:
    system = GrowingFolder(tmp_path, read)
    assert system.run(POLICY, 1) is None
    (tmp_path / "a.csv").write_text("1 2 3")
    (tmp_path / "b.csv").write_text("4 5")
    found = system.run(POLICY, 1)
    assert found["observation"].squeeze(-1).tolist() == [[1, 2, 3], [4, 5, 0]]
    assert found["mask"].tolist() == [[True] * 3, [True, True, False]]
    (tmp_path / "c.csv").write_text("6 half a numb")
    with pytest.raises(SystemFailed, match="half"):
        system.run(POLICY, 1)
    (tmp_path / "c.csv").write_text("6 7")
    assert system.run(POLICY, 1)["observation"].squeeze(-1).tolist() == [[6, 7]]


def called(system: Background) -> TensorDict | None:
    """What a call gives; what it began has ended."""
    found = system.run(POLICY, 1)
    for thread in threading.enumerate():
        if "_work" in thread.name:
            thread.join(10)
    return found


def test_what_a_background_run_had_not_delivered_is_asked_for_again_and_nothing_twice(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("1 2")
    system = Background(GrowingFolder(tmp_path, read))
    assert called(system) is None
    assert called(system)["observation"].squeeze(-1).tolist() == [[1, 2]]
    (tmp_path / "b.csv").write_text("3 4")
    assert called(system) is None  # what it begins reads b
    again = Background(GrowingFolder(tmp_path, read))
    again.load_state_dict(system.state_dict())
    assert called(again) is None
    assert called(again)["observation"].squeeze(-1).tolist() == [[3, 4]]
    assert called(again) is None


def test_values_without_a_width_are_left_out_with_a_note() -> None:
    class Robot:
        def run(self, policy, steps):
            numbers = torch.zeros(2, 5)
            return TensorDict({"observation": numbers, "action": numbers, "next": {"observation": numbers}}, [2, 5])

    found, note = measured(Robot(), POLICY, 5, TrajectoryFormat())
    assert found is None
    assert note == "'observation' of the real trajectories is (2, 5), not (n, T, .); the belief stays as it was"


def runs(width: int, steps: int = 5, **more: torch.Tensor) -> TensorDict:
    values = torch.zeros(2, steps, width)
    return TensorDict({"observation": values, "action": values, "next": {"observation": values}, **more}, [2, steps])


class Given:
    """A system that gives what it was told to."""

    def __init__(self, *data: TensorDict) -> None:
        self._data = list(data)

    def run(self, policy, steps) -> TensorDict:
        return self._data.pop(0)


def test_trajectories_that_do_not_fit_those_before_are_left_out_with_a_note() -> None:
    system, form = Given(runs(3), runs(2), runs(3, 7)), TrajectoryFormat()
    first, note = measured(system, POLICY, 5, form)
    assert (first.shape, note) == ((2, 5), "")
    found, note = measured(system, POLICY, 5, form, first)
    assert found is None
    assert note == "'observation' of the real trajectories is (2,), it was (3,) before; the belief stays as it was"
    found, note = measured(system, POLICY, 5, form, first)
    assert united([first, found]).shape == (4, 7)


def test_a_reward_may_be_missing_at_any_call_and_other_keys_are_left_out() -> None:
    rewarded = runs(3)
    rewarded["next", "reward"] = torch.ones(2, 5, 1)
    system, form = Given(rewarded, runs(3, **{"qpos.hinge": torch.zeros(2, 5, 1)})), TrajectoryFormat()
    first, _ = measured(system, POLICY, 5, form)
    second, note = measured(system, POLICY, 5, form, first)
    assert note == ""
    assert united([first, second])["next", "reward"].flatten(1).sum(1).tolist() == [5, 5, 0, 0]
    assert "qpos.hinge" not in second


def test_logs_that_cannot_stand_together_are_read_again(tmp_path: Path) -> None:
    def wide(path: Path) -> TensorDict:
        return runs(int(path.stem), 2)

    system = GrowingFolder(tmp_path, wide)
    (tmp_path / "1.csv").write_text("")
    (tmp_path / "2.csv").write_text("")
    for _ in range(2):
        with pytest.raises(BadInput, match=r"1.csv, 2.csv cannot stand side by side"):
            system.run(POLICY, 1)
    (tmp_path / "2.csv").unlink()
    assert system.run(POLICY, 1).shape == (2, 2)
    assert system.run(POLICY, 1) is None


# --- whose fault it was ---------------------------------------------------------------------------------------------


class Driven(EnvBase):
    """A robot's driver, which fails in its own code, or gives what TorchRL cannot use."""

    def __init__(self, raises: bool) -> None:
        super().__init__(batch_size=())
        self.raises = raises
        self.observation_spec = Composite(observation=Unbounded(1))
        self.action_spec, self.reward_spec = Unbounded(1), Unbounded(1)

    def _reset(self, tensordict: TensorDict | None = None, **_) -> TensorDict:
        if self.raises:
            raise OSError("no cable")
        return TensorDict({"observation": "a word"})

    def _step(self, tensordict: TensorDict) -> TensorDict:
        raise NotImplementedError

    def _set_seed(self, seed: int | None) -> None:
        """Nothing is drawn."""


class Unplugged:
    def run(self, policy, steps: int) -> TensorDict | None:
        raise OSError("no cable")


def unreadable(folder: Path) -> GrowingFolder:
    (folder / "a.csv").write_text("")

    def read(path: Path) -> TensorDict:
        raise OSError("no cable")

    return GrowingFolder(folder, read)


def beside(system: RealSystem) -> Background:
    background = Background(system)
    called(background)
    return background


def excited(system: RealSystem) -> Excited:
    return Excited(system, POLICY, lambda seen: torch.ones(1), least=1.0, steps=1)


@pytest.mark.parametrize("wrapped", [lambda system: system, beside, excited], ids=["bare", "background", "excited"])
@pytest.mark.parametrize("kind", ["robot", "folder", "driver", "rubbish"])
def test_what_a_users_system_raises_is_a_line(kind: str, wrapped, tmp_path: Path) -> None:
    systems = {
        "robot": Unplugged(),
        "folder": unreadable(tmp_path),
        "driver": RealEnvironment(Driven(raises=True)),
        "rubbish": RealEnvironment(Driven(raises=False)),
    }
    found, note = measured(wrapped(systems[kind]), POLICY, 1, TrajectoryFormat())
    assert found is None
    assert note.startswith("the real system failed (" + ("OSError: no cable)" if kind != "rubbish" else ""))


@pytest.mark.parametrize("wrapped", [lambda system: system, beside, excited], ids=["bare", "background", "excited"])
@pytest.mark.parametrize("kind", ["hidden world", "folder"])
def test_a_mistake_of_ours_is_raised(kind: str, wrapped, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def mistaken(*_, **__) -> None:
        raise KeyError("a mistake of ours")

    monkeypatch.setattr(real, "trajectories", mistaken)
    monkeypatch.setattr(Path, "glob", mistaken)
    world = RealEnvironment(SimulatorEnv(Pendulum(["mass"], 1), PendulumTask(5)))
    system = {"hidden world": world, "folder": GrowingFolder(tmp_path, read)}[kind]
    with pytest.raises(KeyError, match="a mistake of ours"):
        measured(wrapped(system), POLICY, 1, TrajectoryFormat())
