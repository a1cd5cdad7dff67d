"""A policy as ONNX gives the actions of the policy that was loaded; skipped without the extra."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from onlinebayes.objectives import save_policy
from onlinebayes.policies import Origin, load_policy, write_onnx
from onlinebayes.runs import BadInput
from tests.policies.policies import make

pytest.importorskip("safetensors")


@pytest.mark.filterwarnings("ignore")  # of torch and onnxscript, about themselves
@pytest.mark.parametrize("kind", ["ppo", "sac", "ddpg", "one-hot", "index"])
def test_it_gives_the_same_actions(kind: str, tmp_path: Path) -> None:
    reference = pytest.importorskip("onnx.reference")
    pytest.importorskip("onnxscript")
    save_policy(tmp_path, make(kind).policy, Origin("task", {}))
    write_onnx(tmp_path, tmp_path / "policy.onnx")
    session, policy = reference.ReferenceEvaluator(str(tmp_path / "policy.onnx")), load_policy(tmp_path)
    for row in np.random.default_rng(0).normal(size=(20, policy.network.width)).astype(np.float32):
        (action,) = session.run(None, {"observation": row[None]})
        np.testing.assert_allclose(action[0], policy.act(row), rtol=0, atol=1e-5)


@pytest.mark.filterwarnings("ignore")
def test_a_recurrent_one_hands_its_memory_on(tmp_path: Path) -> None:
    reference = pytest.importorskip("onnx.reference")
    pytest.importorskip("onnxscript")
    save_policy(tmp_path, make("recurrent").policy, Origin("task", {}))
    write_onnx(tmp_path, tmp_path / "policy.onnx")
    session, policy = reference.ReferenceEvaluator(str(tmp_path / "policy.onnx")), load_policy(tmp_path)
    memory = np.zeros((1, 2, 16), dtype=np.float32)
    for row in np.random.default_rng(0).normal(size=(10, 5)).astype(np.float32):
        action, memory = session.run(None, {"observation": row[None], "memory": memory})
        np.testing.assert_allclose(action[0], policy.act(row), rtol=0, atol=1e-5)


def test_without_the_extra_a_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_policy(tmp_path, make("sac").policy, Origin("task", {}))
    monkeypatch.setattr("onlinebayes.policies.onnx.find_spec", lambda name: None)
    with pytest.raises(BadInput, match=r"onnx is not installed; pip install 'onlinebayes\[onnx\]'"):
        write_onnx(tmp_path, tmp_path / "policy.onnx")
    assert not (tmp_path / "policy.onnx").exists()
