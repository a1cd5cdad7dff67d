"""Models in, models out: MJCF path, XML text or spec -> a compiled model whose elements all have names."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterator
from pathlib import Path

import mujoco

from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco.collisions import can_touch
from onlinebayes.simulators.mujoco.files import check_files


def load_spec(model: str | Path | mujoco.MjSpec, root: Path | None = None) -> mujoco.MjSpec:
    """The spec of an MJCF file, of MJCF text (it starts with ``<``), or a copy of a spec.

    Args:
        model: the file, the text or the spec.
        root: the folder that must hold every file a model file names, as of a model that somebody else wrote;
            anywhere when None.

    Raises:
        BadInput: the file is missing, is not a model, or reaches outside ``root``.
    """
    if isinstance(model, mujoco.MjSpec):
        return model.copy()
    if isinstance(model, str) and model.lstrip().startswith("<"):
        with _reported("the MJCF text"):
            return mujoco.MjSpec.from_string(model)
    path = Path(model)
    if not path.is_file():
        raise BadInput(f"model '{path}' does not exist", "give the path of an MJCF file, MJCF text or a MjSpec")
    check_files(path, root)
    with _reported(f"model '{path}'"):
        return mujoco.MjSpec.from_file(str(path))


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile; every joint and actuator without a name gets one (``joint0``, ``actuator0``: kind and id).

    Raises:
        BadInput: the model does not compile; carries MuJoCo's own message in one line.
    """
    with _reported("the model"):
        model = spec.compile()
        unnamed = [e for e in (*spec.joints, *spec.actuators) if not e.name]
        for element in unnamed:
            kind = "joint" if isinstance(element, mujoco.MjsJoint) else "actuator"
            element.name = f"{kind}{element.id}"
        return spec.compile() if unnamed else model


def batch_model(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy that keeps a diverged state instead of silently starting anew, so that divergence can be seen.

    Where nothing can touch it does not look for contacts, and of a single tree of bodies, whose constraints always are
    one island, for islands: neither changes a result.
    """
    model = copy.copy(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if not can_touch(model):
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    if model.ntree <= 1:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    return model


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep the engine's warnings off the console and out of MUJOCO_LOG.TXT: they come back as ``failed``."""
    before = mujoco.MjLogConfig.get()
    config = mujoco.MjLogConfig.get()
    config.logto_console, config.logto_file = False, False
    config.set()
    try:
        yield
    finally:
        before.set()


@contextlib.contextmanager
def _reported(what: str) -> Iterator[None]:
    """Turn a refusal of MuJoCo's into a BadInput of one line."""
    try:
        with quiet():
            yield
    except ValueError as error:
        message = " ".join(str(error).split()).rstrip(".")
        raise BadInput(f"{what} does not compile: {message}", "mend the MJCF until plain MuJoCo loads it") from None
