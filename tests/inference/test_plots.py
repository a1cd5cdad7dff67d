"""Corner plots: made without global state, whole files only, every panel labelled."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import pytest
import torch

from onlinebayes.inference import BoxUniform, plots
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from tests.inference.test_distributions import ONE, THREE, _mixture


def test_a_corner_plot_has_labels_truth_and_prior(tmp_path: Path) -> None:
    backend = mpl.rcParams["backend"]
    truth = torch.tensor([0.0, 0.1, 5e-4]).double()
    figure = plots.corner(_mixture(THREE), truth=truth, prior=BoxUniform(THREE), title="round 1", samples=2000)
    visible = [axis for axis in figure.axes if axis.get_visible()]
    assert len(visible) == 6
    assert [axis.get_xlabel() for axis in visible[-3:]] == ["a [m]", "b [kg]", "c [s]"]
    assert [axis.get_ylabel() for axis in visible if axis.get_ylabel()] == ["b [kg]", "c [s]"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["posterior", "prior", "truth"]
    low, high = visible[-1].get_xlim()
    assert low <= 5e-4 <= high
    plots.save(figure, tmp_path / "new" / "corner.png")
    content = (tmp_path / "new" / "corner.png").read_bytes()
    assert content.startswith(b"\x89PNG")
    assert len(content) > 10_000
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["corner.png"]
    assert mpl.rcParams["backend"] == backend


def test_one_parameter_and_the_whole_range() -> None:
    figure = plots.corner(_mixture(ONE, spread=0.01), zoom=False, samples=500)
    assert figure.axes[0].get_xlim() == (-2.0, 3.0)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["posterior"]


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_a_sharp_posterior_is_labelled_by_its_distance_from_a_round_number(scale: str) -> None:
    class Sharp:
        space = ParameterSpace({"length": Parameter(0.1, 1.0, "m", scale)})

        def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> torch.Tensor:
            return 0.5 + 1e-8 * torch.randn(*shape, 1, generator=generator, dtype=torch.float64)

    figure = plots.corner(Sharp())
    figure.canvas.draw()
    axis = figure.axes[0]
    assert axis.get_xlabel().replace("\n", " ") == "length - 0.5 [1e-8 m]"
    shown = [float(label.get_text()) for label in axis.get_xticklabels()]
    assert max(shown) - min(shown) > 2
    assert all(abs(value) < 10 for value in shown)
    assert axis.xaxis.get_offset_text().get_text() == ""


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    figure = plots.corner(_mixture(ONE), samples=500)
    with pytest.raises(BadInput, match="cannot write here"):
        plots.save(figure, tmp_path / "file" / "corner.png")
