"""A distribution's file: the same after loading, and one line for every file that is none."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from onlinebayes.inference import Box, BoxUniform, Posterior, proposals, saving
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from tests.inference.test_protocol import PRIOR, SPACE, belief, neural, simulate


@pytest.mark.parametrize("name", ["it.json", "it.safetensors"])
def test_a_distribution_is_the_same_after_a_file(tmp_path: Path, name: str) -> None:
    if name == "it.safetensors":
        pytest.importorskip("safetensors")
    generator = torch.Generator().manual_seed(0)
    log = BoxUniform(ParameterSpace({"drag": Parameter(0.1, 10.0, "N s/m", "log"), "b": Parameter(-1, 1)}))
    untrained = Posterior(neural().loss).condition(simulate(PRIOR.sample((2,), generator), generator).float())
    cut = proposals.truncated(belief(0.4, 0.05), PRIOR, generator=generator)
    for each in (log, belief(0.4, 0.1), cut, untrained):
        saving.save(each, tmp_path / name)
        again = saving.load(tmp_path / name, each.space)
        assert again.space == each.space
        draws = [x.sample((50,), torch.Generator().manual_seed(1)) for x in (each, again)]
        assert torch.equal(*draws)
        assert torch.equal(each.log_prob(draws[0]), again.log_prob(draws[0]))


def written(path: Path, value: object) -> None:
    path.write_text(json.dumps(value))


def with_checksum(**body: object) -> dict[str, object]:
    return {"content": saving.CONTENT, "format": 1, "sha256": saving._checksum(body), **body}


NONE: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: path.unlink(), "there is no such file"),
    "a folder": (lambda path: (path.unlink(), path.mkdir()), "there is no such file"),
    "empty": (lambda path: path.write_bytes(b""), "is cut off, damaged or of another kind"),
    "a table": (lambda path: path.write_text("mass,length\n0.1,2\n"), "is cut off, damaged or of another kind"),
    "no text": (lambda path: path.write_bytes(b"\xff\xfe\x00"), "is cut off, damaged or of another kind"),
    "half": (lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]), "is cut off"),
    "a pickle": (lambda path: path.write_bytes(pickle.dumps({"content": saving.CONTENT})), "of another kind"),
    "a number": (lambda path: written(path, 3), "holds no distribution"),
    "another thing": (lambda path: written(path, {"weight": [1.0]}), "holds no distribution"),
    "another format": (
        lambda path: written(path, {"content": saving.CONTENT, "format": 2}),
        "was written in format 2, 1 is read here; read it with the version",
    ),
    "half of the keys": (lambda path: written(path, with_checksum(space=[], belief=None)), "is damaged: "),
    "of fewer parameters": (
        lambda path: written(path, with_checksum(space=[], belief=saving._written(saving.to_state(PRIOR)))),
        "is damaged: the saved distribution has 2 parameters, the space 0",
    ),
}


@pytest.mark.parametrize(("spoil", "said"), NONE.values(), ids=NONE)
def test_what_is_no_distribution_is_refused_in_one_line(
    tmp_path: Path, spoil: Callable[[Path], object], said: str
) -> None:
    path = tmp_path / "it.json"
    saving.save(belief(0.4, 0.1), path)
    spoil(path)
    with pytest.raises(BadInput, match=said) as caught:
        saving.load(path)
    assert str(path) in str(caught.value)
    assert "; " in str(caught.value), "no cure"


def test_a_changed_digit_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "it.json"
    saving.save(belief(0.375, 0.1), path)
    text = path.read_text()
    assert "0.375" in text
    path.write_text(text.replace("0.375", "0.376", 1))
    with pytest.raises(BadInput, match="is damaged: its checksum is another"):
        saving.load(path)


def test_columns_in_another_order_are_refused(tmp_path: Path) -> None:
    saving.save(PRIOR, tmp_path / "it.json")
    wider = SPACE.replaced("a", Parameter(-5.0, 5.0, "m"))
    assert saving.load(tmp_path / "it.json", wider).space == SPACE
    with pytest.raises(BadInput, match=r"is over a \[m\], b \[kg\]; the worlds read b \[kg\], a \[m\]"):
        saving.load(tmp_path / "it.json", SPACE.subspace(["b", "a"]))


def test_weights_are_read_into_the_box_that_they_speak_of(tmp_path: Path) -> None:
    first, second, other = neural().loss, neural().loss, neural().loss
    torch.save(first.state_dict(), tmp_path / "weights.pt")
    weights = torch.load(tmp_path / "weights.pt", weights_only=True)
    second.load_state_dict(weights)
    data = simulate(PRIOR.sample((3,)), torch.Generator().manual_seed(0)).float()
    torch.testing.assert_close(first(data)["loss_posterior"], second(data)["loss_posterior"], rtol=0, atol=0)
    other.estimator.box = Box(SPACE, torch.tensor([0.0, 0.0]).double(), torch.tensor([0.5, 0.5]).double())
    with pytest.raises(BadInput, match="build the estimator in that box"):
        other.load_state_dict(weights)


class Peak:
    """A distribution of somebody's own: the box's centre, always."""

    def __init__(self, box: Box) -> None:
        self.box, self.space = box, box.space

    def log_prob(self, theta: torch.Tensor) -> torch.Tensor:
        return torch.zeros(theta.shape[:-1])

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> torch.Tensor:
        return self.box.from_frame(torch.full((*shape, len(self.space)), 0.5, dtype=torch.float64))

    def to_state(self) -> dict[str, object]:
        return {"low": self.box.low, "high": self.box.high}

    @classmethod
    def from_state(cls, space: ParameterSpace, state: dict[str, torch.Tensor]) -> Peak:
        return cls(Box(space, state["low"], state["high"]))


def test_a_distribution_of_ones_own_is_saved_once_it_is_registered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(saving, "_KINDS", {})
    own = Peak(PRIOR.box)
    with pytest.raises(BadInput, match=r"Peak cannot be saved.*register it"):
        saving.save(own, tmp_path / "peak.json")
    saving.register("peak", Peak)
    saving.save(own, tmp_path / "peak.json")
    again = saving.load(tmp_path / "peak.json", SPACE)
    assert type(again) is Peak
    assert torch.equal(again.sample((2,)), own.sample((2,)))
    for taken in ("mixture", "peak"):
        with pytest.raises(BadInput, match="stands for another"):
            saving.register(taken, Box)
    monkeypatch.setattr(saving, "_KINDS", {})
    with pytest.raises(BadInput, match=r"kind 'peak'.*register"):
        saving.load(tmp_path / "peak.json", SPACE)
