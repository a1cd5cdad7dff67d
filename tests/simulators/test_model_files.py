"""What a model that came from elsewhere may not do: each is one clear line, at once."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco.model import compile_spec, load_spec

MESH = "\n".join(["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "f 1 3 2", "f 1 2 4", "f 1 4 3", "f 2 3 4", ""])
BODY = '<worldbody><body><joint name="hinge"/><geom type="sphere" size="1"/>{}</body></worldbody>'
LAUGHS = (
    '<!DOCTYPE x [<!ENTITY a "ha">'
    + "".join(f'<!ENTITY a{k} "{f"&a{k - 1 if k else chr(32)};".replace(" ", "") * 10}">' for k in range(10))
    + "]>"
)


def xml(inside: str = "", body: str = "") -> str:
    return f"<mujoco>{inside}{BODY.format(body)}</mujoco>"


def mesh(file: str, compiler: str = "") -> str:
    return xml(f'<compiler {compiler}/><asset><mesh name="m" file="{file}"/></asset>', '<geom type="mesh" mesh="m"/>')


REPLICATE = '<replicate count="1000" offset="0 0 1">{}</replicate>'

BAD: dict[str, tuple[str, str]] = {
    "include above": (xml('<include file="../secret.xml"/>'), "outside the folder"),
    "include absolute": (xml('<include file="{outside}/secret.xml"/>'), "outside the folder"),
    "include by a link": (xml('<include file="link.xml"/>'), "outside the folder"),
    "include in an include": (xml('<include file="inner.xml"/>'), r"inner\.xml: .*outside the folder"),
    "include of itself": (xml('<include file="model.xml"/>'), "does not compile"),
    "include that is missing": (xml('<include file="none.xml"/>'), "does not compile"),
    "mesh above": (mesh("../secret.obj"), "outside the folder"),
    "mesh by its folder": (mesh("secret.obj", 'meshdir=".."'), "outside the folder"),
    "mesh in a linked folder": (mesh("linked/secret.obj"), "outside the folder"),
    "mesh that is missing": (mesh("none.obj"), "does not compile"),
    "texture above": (
        xml('<asset><texture name="t" type="2d" file="../secret.png"/></asset>'),
        "outside the folder",
    ),
    "billion laughs": (LAUGHS + xml().replace("<mujoco>", '<mujoco model="&a9;">'), "document type or entities"),
    "external entity": ('<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]>' + xml(), "document type or entities"),
    "replicated": (xml(body=REPLICATE.format(REPLICATE.format('<site name="s"/>'))), "replicate makes 1e.06 copies"),
    "huge texture": (
        xml('<asset><texture name="t" type="2d" builtin="flat" width="1000000" height="1000000"/></asset>'),
        r"texture has 1e\+12 values",
    ),
    "huge height field": (
        xml('<asset><hfield name="h" nrow="1000000" ncol="1000000" size="1 1 1 1"/></asset>'),
        r"hfield has 1e\+12 values",
    ),
    "huge memory": (xml('<size memory="900P"/>'), "size memory='900P'"),
    "nested": ("<mujoco>" + "<body>" * 50_000, "does not compile"),
    "cut short": (xml()[:40], "does not compile"),
    "NUL bytes": (xml()[:40] + "\0" + xml()[40:], "NUL bytes"),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.xml").write_text("<mujoco/>")
    (tmp_path / "secret.obj").write_text(MESH)
    (tmp_path / "secret.png").write_bytes(b"png")
    (inside / "link.xml").symlink_to(tmp_path / "secret.xml")
    (inside / "linked").symlink_to(tmp_path)
    (inside / "inner.xml").write_text('<mujoco><include file="../secret.xml"/></mujoco>')
    return inside


@pytest.mark.parametrize("name", BAD)
def test_a_hostile_model_is_one_line(folder, name):
    text, message = BAD[name]
    (folder / "model.xml").write_text(text.replace("{outside}", str(folder.parent)))
    before, start = sorted(folder.rglob("*")), time.process_time()
    with pytest.raises(BadInput) as caught:
        compile_spec(load_spec(folder / "model.xml", root=folder))
    assert re.search(message, str(caught.value)), caught.value
    assert "\n" not in str(caught.value)
    assert time.process_time() - start < 5
    assert sorted(folder.rglob("*")) == before


def test_a_model_that_is_itself_a_link_out_of_the_folder(folder):
    with pytest.raises(BadInput, match="outside the folder"):
        load_spec(folder / "link.xml", root=folder)


def test_files_within_the_folder_are_read(folder):
    (folder / "assets").mkdir()
    (folder / "assets" / "m.obj").write_text(MESH)
    (folder / "part.xml").write_text('<mujoco><option timestep="0.003"/></mujoco>')
    (folder / "model.xml").write_text(
        mesh("m.obj", 'meshdir="assets"').replace("<mujoco>", '<mujoco><include file="part.xml"/>', 1)
    )
    model = compile_spec(load_spec(folder / "model.xml", root=folder))
    assert model.opt.timestep == 0.003
    assert model.nmesh == 1


def test_without_a_root_a_model_reads_where_it_likes(folder):
    (folder / "model.xml").write_text(mesh("../secret.obj"))
    assert compile_spec(load_spec(folder / "model.xml")).nmesh == 1
