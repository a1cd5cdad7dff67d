"""A distribution's file: the same after loading, and one line for every file that is none."""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from onlinebayes.inference import Box, BoxUniform, Posterior, proposals, saving
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, Checkpoints
from tests.inference.test_protocol import PRIOR, SPACE, belief, neural, simulate


def test_a_distribution_is_the_same_after_a_file(tmp_path: Path) -> None:
    generator = torch.Generator().manual_seed(0)
    log = BoxUniform(ParameterSpace({"drag": Parameter(0.1, 10.0, "N s/m", "log"), "b": Parameter(-1, 1)}))
    untrained = Posterior(neural().loss).condition(simulate(PRIOR.sample((2,), generator), generator).float())
    cut = proposals.truncated(belief(0.4, 0.05), PRIOR, generator=generator)
    for each in (log, belief(0.4, 0.1), cut, untrained):
        saving.save(each, tmp_path / "it.pt")
        again = saving.load(tmp_path / "it.pt", each.space)
        assert again.space == each.space
        draws = [x.sample((50,), torch.Generator().manual_seed(1)) for x in (each, again)]
        assert torch.equal(*draws)
        assert torch.equal(each.log_prob(draws[0]), again.log_prob(draws[0]))


def written(path: Path, value: object) -> None:
    torch.save(value, path)


NONE: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: path.unlink(), "there is no such file"),
    "a folder": (lambda path: (path.unlink(), path.mkdir()), "there is no such file"),
    "empty": (lambda path: path.write_bytes(b""), "is cut off, damaged or of another kind"),
    "text": (lambda path: path.write_text("mass,length\n0.1,2\n"), "is cut off, damaged or of another kind"),
    "half": (lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]), "is cut off"),
    "all but a byte": (lambda path: path.write_bytes(path.read_bytes()[:-1]), "is cut off|is damaged"),
    "a pickle": (lambda path: path.write_bytes(pickle.dumps({"content": saving.CONTENT})), "of another kind"),
    "a tensor": (lambda path: written(path, torch.zeros(3)), "holds no distribution"),
    "weights": (lambda path: written(path, torch.nn.Linear(1, 1).state_dict()), "holds no distribution"),
    "a module": (lambda path: written(path, torch.nn.Linear(1, 1)), "of another kind"),
    "a checkpoint": (
        lambda path: Checkpoints(path.parent, "x").save({"belief": saving.to_state(PRIOR)}).rename(path),
        "holds no distribution",
    ),
    "another format": (
        lambda path: written(path, {"content": saving.CONTENT, "format": 2}),
        "was written in format 2, 1 is read here; read it with the version",
    ),
    "half of the keys": (
        lambda path: written(path, {"content": saving.CONTENT, "format": 1, "space": []}),
        "is damaged: 'belief'",
    ),
    "of fewer parameters": (
        lambda path: written(
            path, {"content": saving.CONTENT, "format": 1, "space": [], "belief": saving.to_state(PRIOR)}
        ),
        "is damaged: the saved distribution has 2 parameters, the space 0",
    ),
}


@pytest.mark.parametrize(("spoil", "said"), NONE.values(), ids=NONE)
def test_what_is_no_distribution_is_refused_in_one_line(
    tmp_path: Path, spoil: Callable[[Path], object], said: str
) -> None:
    path = tmp_path / "it.pt"
    saving.save(belief(0.4, 0.1), path)
    spoil(path)
    with pytest.raises(BadInput, match=said) as caught:
        saving.load(path)
    assert str(path) in str(caught.value)
    assert "; " in str(caught.value), "no cure"


def test_a_changed_byte_is_noticed_wherever_numbers_stand(tmp_path: Path) -> None:
    path = tmp_path / "it.pt"
    saving.save(belief(0.375, 0.1), path)
    content = path.read_bytes()
    place = content.index(torch.tensor([0.375], dtype=torch.float64).numpy().tobytes())
    path.write_bytes(content[: place + 5] + bytes([content[place + 5] ^ 1]) + content[place + 6 :])
    assert torch.load(io.BytesIO(path.read_bytes()), weights_only=True)["format"] == 1, "torch does not look"
    with pytest.raises(BadInput, match="is damaged: the checksum of"):
        saving.load(path)


def test_columns_in_another_order_are_refused(tmp_path: Path) -> None:
    saving.save(PRIOR, tmp_path / "it.pt")
    wider = SPACE.replaced("a", Parameter(-5.0, 5.0, "m"))
    assert saving.load(tmp_path / "it.pt", wider).space == SPACE
    with pytest.raises(BadInput, match=r"is over a \[m\], b \[kg\]; the worlds read b \[kg\], a \[m\]"):
        saving.load(tmp_path / "it.pt", SPACE.subspace(["b", "a"]))


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
