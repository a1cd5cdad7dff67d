"""What an experiment is told, what is hidden from it, and what its folder remembers."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import nn

from onlinebayes.experiments import Options, Settings, folder_of, hidden_truth, place_of, recorded_settings
from onlinebayes.experiments.running import built, each_seed
from onlinebayes.experiments.seeds import seeds_of
from onlinebayes.objectives import ActorCriticSettings, DDPGSettings, PPOSettings, SACSettings, sac, settings_of
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, RunFolder
from recipes import pendulum

SPACE = ParameterSpace({"mass": Parameter(1.0, 3.0, "kg"), "length": Parameter(0.5, 1.5, "m")})


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(BadInput, match="seed -1; needs seed >= 0"):
        Options(seed=-1)
    with pytest.raises(BadInput, match=r"noise 1.0; needs .* 0 <= noise < 1"):
        Settings(noise=1.0)


def test_seed_zero_hides_the_values_that_are_given_and_others_points_of_a_sequence() -> None:
    own = hidden_truth(SPACE, 0, {"mass": 2.5, "length": 0.6})
    assert own.tolist() == [2.5, 0.6]
    points = torch.stack([hidden_truth(SPACE, seed, {}) for seed in (1, 2, 3)])
    torch.testing.assert_close(points[:2], torch.tensor([[2.5, 0.75], [1.5, 1.25]], dtype=torch.float64))
    assert torch.equal(points[0], hidden_truth(SPACE, 1, {"mass": 1.0, "length": 0.5}))


def test_folders_are_called_after_experiment_kind_and_seed() -> None:
    assert folder_of("own", Options(seed=3)) == "own-3"
    assert place_of("pendulum", Settings(kind="prior", short=True)) == Path("out/pendulum-prior-0-short")


def test_a_run_is_the_same_in_another_folder_and_with_no_workers() -> None:
    assert set(recorded_settings(Settings(out="elsewhere"))) == {"seed", "short", "noise", "kind"}
    assert recorded_settings(Settings(ray_workers=2))["ray_workers"] == 2


def test_a_folder_remembers_the_objectives_settings_and_refuses_others(tmp_path: Path) -> None:
    made = pendulum.build(Settings(short=True))
    told = settings_of(made.trainer.objective)
    assert told["alpha"] == 0.3
    assert told == settings_of(sac(*made.problem.specs, pendulum.LEARNING))
    with RunFolder(tmp_path, "pendulum", objective=told):
        pass
    assert json.loads((tmp_path / "run.json").read_text("utf-8"))["objective"]["widths"] == [64, 64]
    with RunFolder(tmp_path, "pendulum", objective=told):
        pass
    with RunFolder(tmp_path, "pendulum"):  # who tells nothing of it asks nothing
        pass
    other = settings_of(sac(*made.problem.specs, SACSettings(alpha=0.5)))
    with pytest.raises(BadInput, match=r"alpha = 0\.3 \(now 0\.5\)"):
        RunFolder(tmp_path, "pendulum", objective=other).__enter__()


def test_a_truth_may_be_chosen_by_hand() -> None:
    own = {"mass": 2.5, "length": 0.6}
    assert hidden_truth(SPACE, 0, own, ["length=1.25"]).tolist() == [2.5, 1.25]
    seed = hidden_truth(SPACE, 2, own)
    assert hidden_truth(SPACE, 2, own, ["mass = 1.5e0"]).tolist() == [1.5, pytest.approx(float(seed[1]))]
    for text, said in {
        "masss=2": "has no parameter 'masss'; nearest: mass",
        "mass=4": r"--truth mass=4 is outside of the prior's bounds; give a value from 1 to 3 kg",
        "mass=nan": "outside of the prior's bounds",
        "mass=heavy": "--truth mass=heavy; give a number",
        "mass": "--truth mass; write --truth NAME=VALUE",
    }.items():
        with pytest.raises(BadInput, match=said):
            hidden_truth(SPACE, 0, own, [text])
    with pytest.raises(BadInput, match="--truth gives mass twice: 1 and 2"):
        hidden_truth(SPACE, 0, own, ["mass=1", "mass=2"])


def test_settings_of_what_learns_are_read_by_their_types() -> None:
    told = ("learning_rate=1e-4", "epochs=7", "widths=32,16", "normalise=True", "activation=elu", "target_kl=0.02")
    made = Settings(set=told).learning(PPOSettings(entropy=0.5, target_kl=None))
    assert made == PPOSettings(
        entropy=0.5, learning_rate=1e-4, epochs=7, widths=(32, 16), normalise=True, activation=nn.ELU, target_kl=0.02
    )
    assert Settings(set=("target_kl=none",)).learning(PPOSettings(target_kl=1.0)).target_kl is None
    assert Settings(set=("value_range=-10,0",)).learning(DDPGSettings()).value_range == (-10.0, 0.0)
    assert Settings(set=("width=8",)).learning(ActorCriticSettings()).width == 8
    assert Settings().learning(SACSettings(tau=0.5)) == SACSettings(tau=0.5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("learning_rat=1", "PPOSettings has no 'learning_rat'; nearest: learning_rate"),
        ("learning_rate", "--set learning_rate; write --set NAME=VALUE"),
        ("learning_rate=fast", "learning_rate = fast; learning_rate is a number"),
        ("epochs=2.5", "epochs = 2.5; epochs is a whole number"),
        ("normalise=1", "normalise = 1; normalise is true or false"),
        ("widths=64,wide", "widths = wide; widths is a whole number"),
        ("activation=rely", "activation = rely is no activation of torch.nn; nearest: relu"),
        ("learning_rate=-1", "learning_rate = -1.0: it must be positive and finite"),
        ("target_kl=nan", "target_kl = nan: it must be positive and finite"),
    ],
)
def test_a_setting_that_cannot_be_is_one_line(text: str, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        Settings(set=(text,)).learning(PPOSettings())


def test_a_range_needs_both_ends() -> None:
    with pytest.raises(BadInput, match="value_range = 1; value_range is 2 numbers with a comma between them"):
        Settings(set=("value_range=1",)).learning(DDPGSettings())


def test_options_that_were_not_used_are_not_recorded() -> None:
    told = recorded_settings(Settings(truth=("mass=2",), set=("tau=0.1",)))
    assert (told["truth"], told["set"]) == (("mass=2",), ("tau=0.1",))
    assert "seeds" not in recorded_settings(Settings(seeds="0..4"))


def test_what_an_experiment_does_not_take_is_refused() -> None:
    def own(settings: Settings):
        """A recipe that looks at neither option."""
        return pendulum.build(replace(settings, truth=(), set=()))

    with pytest.raises(BadInput, match="the hidden system of this experiment is its own; leave out --truth"):
        built(own, Settings(truth=("mass=0.5",)))
    with pytest.raises(BadInput, match="takes no settings of what learns; leave out --set"):
        built(own, Settings(set=("tau=0.5",)))
    made = built(pendulum.build, Settings(truth=("mass=0.5",), set=("tau=0.5",)))
    assert made.truth.tolist() == [1.0, 0.5]
    assert settings_of(made.trainer.objective)["tau"] == 0.5


def test_seeds_are_read_and_wrong_ones_refused() -> None:
    assert seeds_of("0..4") == [0, 1, 2, 3, 4]
    assert seeds_of("7, 1..2") == [7, 1, 2]
    for text in ("4..0", "a", "0-4", "1,,2", "-1..2", "0...4"):
        with pytest.raises(BadInput, match=r"write 0\.\.4, or 0,3,7"):
            seeds_of(text)
    with pytest.raises(BadInput, match="names a seed twice"):
        seeds_of("0..2,1")
    with pytest.raises(BadInput, match=r"--seed 3 beside --seeds 0\.\.2; give one of them"):
        each_seed("pendulum", pendulum.build, Settings(seed=3, seeds="0..2"))
