"""A spec as bytes that another process can read: MJCF text with all digits, and the files that it names."""

from __future__ import annotations

from pathlib import Path

import mujoco

from onlinebayes.simulators.mujoco.export import to_xml
from onlinebayes.simulators.mujoco.model import compile_spec


def packed(spec: mujoco.MjSpec) -> tuple[str, dict[str, bytes], str]:
    """The text, the files in memory, and the folder that other files are looked for in."""
    source = spec.copy()
    compile_spec(source)
    return to_xml(source), dict(spec.assets), str(Path(spec.modelfiledir or ".").resolve())


def unpacked(parts: tuple[str, dict[str, bytes], str]) -> mujoco.MjSpec:
    """The spec of :func:`packed`."""
    text, assets, folder = parts
    spec = mujoco.MjSpec.from_string(text, assets=assets) if assets else mujoco.MjSpec.from_string(text)
    spec.modelfiledir = folder
    return spec
