"""CartPole equals Gymnasium's, whatever its parameters; its task too."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.runs import BadInput


def test_start_is_gymnasiums_box() -> None:
    generator = torch.Generator().manual_seed(0)
    start = CartPoleTask().start(torch.zeros(1000, 2, dtype=torch.float64), generator)
    everything = torch.cat((start["qpos"], start["qvel"]))
    assert everything.abs().max() <= 0.05
    assert everything.max() > 0.0495
    assert everything.min() < -0.0495


def test_parameters_are_chosen_by_name_and_unknown_ones_refused() -> None:
    simulator = CartPole(["mass", "length"], worlds=3)
    assert simulator.parameters.names == ("mass", "length")
    assert simulator.nominal.tolist() == [0.1, 0.5]
    with pytest.raises(BadInput, match="parameter 'lenght' is unknown; nearest: length"):
        CartPole(["lenght"])


def _state(x: np.ndarray) -> TensorDict:
    x = torch.as_tensor(x)
    return TensorDict({"qpos": x[None, [0, 2]], "qvel": x[None, [1, 3]]}, batch_size=(1,))


def _flat(state: TensorDict) -> np.ndarray:
    return torch.stack((state["qpos"], state["qvel"]), dim=-1).flatten().numpy()
