"""Distributions in files: what is loaded draws what was saved."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from onlinebayes.inference import Box, BoxUniform, TruncatedMixture, proposals, saving
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput

SPACE = ParameterSpace({"mass": Parameter(0.1, 10.0, "kg", "log"), "length": Parameter(0.5, 2.0, "m")})


def mixture(shared: bool) -> TruncatedMixture:
    lower = torch.linalg.cholesky(torch.tensor([[0.02, 0.01], [0.01, 0.03]], dtype=torch.float64))
    factors = torch.stack([lower, lower if shared else 2 * lower])
    means = torch.tensor([[0.3, 0.4], [0.9, 0.1]], dtype=torch.float64)
    return TruncatedMixture(torch.tensor([0.0, 1.0]).double(), means, factors, Box.whole(SPACE))


@pytest.mark.parametrize("kind", ["uniform", "shared", "mixture", "truncated"])
def test_a_file_gives_back_the_distribution(kind: str, tmp_path: Path) -> None:
    beliefs = {"uniform": BoxUniform(SPACE), "shared": mixture(True), "mixture": mixture(False)}
    if kind == "truncated":
        belief = proposals.truncated(mixture(False), generator=torch.Generator().manual_seed(0))
    else:
        belief = beliefs[kind]
    saving.save(belief, tmp_path / "belief.json")
    loaded = saving.load(tmp_path / "belief.json", SPACE)
    drawn, again = (one.sample((50,), torch.Generator().manual_seed(1)) for one in (belief, loaded))
    assert torch.equal(drawn, again)
    assert torch.allclose(loaded.log_prob(drawn), belief.log_prob(drawn), atol=1e-10)


def test_another_model_is_refused(tmp_path: Path) -> None:
    saving.save(BoxUniform(SPACE), tmp_path / "belief.json")
    other = SPACE.replaced("length", Parameter(0.5, 3.0, "m"))
    with pytest.raises(BadInput, match="other parameters or bounds: length"):
        saving.load(tmp_path / "belief.json", other)


@pytest.mark.parametrize("text", [None, "", "[]", "{}", '{"parameters": {}, "distribution": {"kind": "mixture"}}'])
def test_what_is_no_distribution_is_refused(text: str | None, tmp_path: Path) -> None:
    path = tmp_path / "belief.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(BadInput, match=r"belief\.json: no distribution can be read"):
        saving.load(path)
