"""Meshes, height fields and textures that stand in no file: into the text, or beside it."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import mujoco
import numpy as np
import pytest

from onlinebayes.simulators.mujoco.assets import put_beside, take_shapes

CORNERS = b"v 0 0 0\nv .3 0 0\nv 0 .2 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def _png() -> bytes:
    """A grey pixel."""
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", 1, 1, 8, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(b"\0\x80")),
        (b"IEND", b""),
    )
    chunks = [struct.pack(">I", len(d)) + kind + d + struct.pack(">I", zlib.crc32(kind + d)) for kind, d in parts]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


FILES = {
    "parts/arm.obj": CORNERS,
    "hills.bin": struct.pack("<ii6f", 2, 3, 0, 1, 2, 3, 4, 5),
    "grey.png": _png(),
}
MODEL = """
<mujoco><compiler meshdir="shapes" texturedir="pictures" {more}/>
<asset><mesh name="arm" file="parts/arm.obj" scale="1 2 1" refpos=".01 .02 .03" refquat="1 1 0 0"/>
<hfield name="hills" file="hills.bin" size="1 1 .2 .1"/>
<texture name="grey" type="2d" file="grey.png"/><material name="grey" texture="grey"/></asset>
<worldbody><geom type="hfield" hfield="hills" material="grey"/>
<body name="arm"><joint name="hinge" axis="0 1 0"/><geom name="arm" type="mesh" mesh="arm" pos="0 0 1"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("more", ["", 'strippath="true"'])
def test_files_in_memory_are_written_beside(tmp_path: Path, more: str) -> None:
    spec = mujoco.MjSpec.from_string(MODEL.format(more=more), assets=FILES)
    model = spec.compile()
    copy = spec.copy()
    written = put_beside(copy, tmp_path, "assets")
    assert sorted(written) == ["assets/arm.obj", "assets/grey.png", "assets/hills.bin"]
    (tmp_path / "assets").mkdir()
    for name, content in written.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "model.xml").write_text(copy.to_xml())
    again = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    assert np.array_equal(again.mesh_vert, model.mesh_vert)
    assert np.array_equal(again.hfield_data, model.hfield_data)
    assert np.array_equal(again.tex_data, model.tex_data)


def test_a_file_on_the_disk_stays_there(tmp_path: Path) -> None:
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "own.obj").write_bytes(CORNERS)
    text = MODEL.format(more="").replace("<hfield n", '<mesh name="own" file="own.obj"/><hfield n')
    spec = mujoco.MjSpec.from_string(text, assets=FILES)
    spec.modelfiledir = str(tmp_path)
    spec.compile()
    written = put_beside(spec, tmp_path, "assets")
    assert sorted(written) == ["assets/arm.obj", "assets/grey.png", "assets/hills.bin"]
    assert [mesh.file for mesh in spec.meshes] == ["../assets/arm.obj", "own.obj"]
    assert spec.compiler.meshdir == "shapes"


def test_a_compiled_model_gives_its_shapes() -> None:
    spec = mujoco.MjSpec.from_string(MODEL.format(more=""), assets=FILES)
    model = spec.compile()
    bare = mujoco.MjSpec.from_string(MODEL.format(more=""))
    take_shapes(bare, model)
    bare.compile()
    again = mujoco.MjModel.from_xml_string(bare.to_xml())
    np.testing.assert_allclose(again.body_inertia, model.body_inertia, rtol=1e-5)
    np.testing.assert_allclose(again.body_ipos, model.body_ipos, atol=1e-6)
    np.testing.assert_allclose(again.hfield_data, model.hfield_data)
    assert again.geom("arm").rbound == pytest.approx(model.geom("arm").rbound, rel=1e-5)
    with pytest.raises(ValueError, match="1 assets in the text, 0 in the model"):
        take_shapes(mujoco.MjSpec.from_string(MODEL.format(more="")), mujoco.MjModel.from_xml_string("<mujoco/>"))
