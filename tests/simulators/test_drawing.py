"""Shapes, where they are, and pictures of them."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from envs.acrobot import Acrobot
from envs.cartpole import CartPole
from envs.hopper import hopper
from envs.mountain_car import MountainCar, MountainCarContinuous
from envs.pendulum import Pendulum
from envs.reach import ReachTask, arm
from onlinebayes.simulators import Drawable, Shape, Simulator
from onlinebayes.simulators.drawing import OBLIQUE, SIDE, View, planar, render, render_state, scene, view_of
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco import drawing as mujoco_drawing

RED, BLUE = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)
SYSTEMS = {
    "cartpole": lambda: CartPole(("length", "mass")),
    "pendulum": lambda: Pendulum(("length", "mass")),
    "mountain car": MountainCar,
    "continuous mountain car": MountainCarContinuous,
    "acrobot": lambda: Acrobot(("length1", "length2")),
    "reach": arm,
    "hopper": hopper,
}


def states(simulator: Simulator, number: int = 12) -> TensorDict:
    shape = simulator.state["qpos"].shape[-1], simulator.state["qvel"].shape[-1]
    q, v = (0.4 * torch.randn(number, n, dtype=torch.float64) for n in shape)
    return TensorDict({"qpos": q, "qvel": v}, batch_size=(number,))


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, turned: Tensor | None = None) -> Tensor:
    turned = torch.tensor([1.0, 0, 0, 0], dtype=torch.float64) if turned is None else turned
    return torch.cat([torch.tensor([x, y, z], dtype=torch.float64), turned])[None]


@pytest.mark.parametrize("make", SYSTEMS.values(), ids=SYSTEMS)
def test_every_system_says_what_it_looks_like(make) -> None:
    simulator = make()
    assert isinstance(simulator, Drawable)
    theta, some = simulator.nominal, states(simulator)
    shapes, poses = simulator.shapes(theta), simulator.poses(theta, some)
    assert poses.shape == (12, len(shapes), 7)
    assert len({shape.name for shape in shapes}) == len(shapes)
    assert all(shape.name.isidentifier() for shape in shapes), "names are parts of paths"
    torch.testing.assert_close(poses[..., 3:].norm(dim=-1), torch.ones(12, len(shapes)).double())
    moved = (poses - poses[:1]).abs().amax((0, 2)) > 0
    assert not moved[[not shape.moving for shape in shapes]].any()
    assert moved[[shape.moving for shape in shapes]].any()
    picture = render(shapes, poses[0], size=(60, 80), view=view_of(shapes, poses))
    assert picture.shape == (60, 80, 3)
    assert picture.dtype == np.uint8
    assert (picture == 255).all(-1).mean() > 0.2, "paper"
    assert (picture < 200).any(-1).mean() > 0.01, "ink"


def test_a_longer_pole_is_drawn_longer_and_ends_where_the_equations_have_it() -> None:
    simulator = CartPole(("length",))
    some = TensorDict({"qpos": torch.tensor([[0.3, 0.5]]).double()}, batch_size=(1,))
    for half in (0.5, 0.9):
        theta = torch.tensor([half], dtype=torch.float64)
        shapes, poses = simulator.shapes(theta), simulator.poses(theta, some)
        k = [shape.name for shape in shapes].index("pole")
        view = view_of(shapes[k : k + 1], poses[:, k : k + 1])
        radius = shapes[k].size[0]
        width, height = 2 * half * math.sin(0.5) + 2 * radius, 2 * half * math.cos(0.5) + 2 * radius
        margin = 0.05 * max(width, height)
        assert view.low == pytest.approx((0.3 - radius - margin, -radius - margin))
        assert view.high == pytest.approx((0.3 - radius + width + margin, -radius + height + margin))


def test_acrobots_elbow_and_tip_hang_together() -> None:
    simulator = Acrobot(("length1", "length2"))
    theta, some = torch.tensor([0.8, 1.7], dtype=torch.float64), states(simulator)
    shapes, poses = simulator.shapes(theta), simulator.poses(theta, some)
    first, second, elbow = (poses[:, [s.name for s in shapes].index(n)] for n in ("link1", "link2", "elbow"))
    a, b = some["qpos"][:, 0], some["qpos"].sum(-1)
    torch.testing.assert_close(first[:, [0, 2]] * 2, elbow[:, [0, 2]])
    torch.testing.assert_close(elbow[:, 2], -0.8 * a.cos())
    torch.testing.assert_close(2 * second[:, 2] - elbow[:, 2], -0.8 * a.cos() - 1.7 * b.cos())


def test_the_car_stands_on_its_hill() -> None:
    simulator, x = MountainCar(), torch.linspace(-1.2, 0.6, 30).double()
    some = TensorDict({"qpos": x[:, None], "qvel": x[:, None]}, batch_size=(30,))
    shapes, poses = simulator.shapes(simulator.nominal), simulator.poses(simulator.nominal, some)
    hill = shapes[0]
    top = hill.vertices[hill.vertices[:, 2] > 0.05]
    for name in ("rear_wheel", "front_wheel"):
        wheel = [shape.name for shape in shapes].index(name)
        place, radius = poses[:, wheel][:, None, [0, 2]], shapes[wheel].size[0]
        distance = (place - top[:, [0, 2]]).norm(dim=-1).amin(-1)
        assert (distance[1:-1] - radius).abs().max() < 0.02


def test_mujocos_geoms_stand_where_mujoco_has_them() -> None:
    simulator = hopper()
    some = states(simulator)
    shapes, poses = simulator.shapes(simulator.nominal), simulator.poses(simulator.nominal, some)
    model = simulator.model
    data = mujoco.MjData(model)
    assert len(shapes) == model.ngeom
    for k in range(len(some)):
        data.qpos[:] = some["qpos"][k].numpy()
        mujoco.mj_forward(model, data)
        matrix = np.empty(9)
        for i in range(model.ngeom):
            mujoco.mju_quat2Mat(matrix, poses[k, i, 3:].numpy())
            np.testing.assert_allclose(poses[k, i, :3], data.geom_xpos[i], atol=1e-12)
            np.testing.assert_allclose(matrix, data.geom_xmat[i], atol=1e-12)


def test_of_mujocos_geoms_the_visible_ones_are_drawn_meshes_too() -> None:
    text = """
    <mujoco><asset><mesh name="wedge" vertex="0 0 0  .3 0 0  0 .2 0  0 0 .1"/>
    <material name="green" rgba="0 1 0 1"/></asset><worldbody>
    <geom name="ground" type="plane" size="0 0 1"/><geom type="box" size=".1 .1 .1" group="3"/>
    <geom type="sphere" size=".1" rgba="1 0 0 0"/>
    <body name="left/arm" pos="1 0 2" euler="0 0 90"><joint/><geom type="mesh" mesh="wedge" material="green"/>
    <geom type="ellipsoid" size=".1 .2 .3" mass="1"/></body></worldbody></mujoco>"""
    simulator = MujocoSimulator(text)
    shapes = simulator.shapes(simulator.nominal)
    assert [(shape.name, shape.kind, shape.moving) for shape in shapes] == [
        ("ground_0", "plane", False),
        ("left_arm_3", "mesh", True),
        ("left_arm_4", "ellipsoid", True),
    ]
    assert all(half > 1 for half in shapes[0].size[:2])
    assert shapes[1].colour == (0, 1, 0, 1)
    poses = simulator.poses(simulator.nominal, simulator.state)
    view = view_of(shapes[1:2], poses[:, 1:2], SIDE)
    # Turned by 90 degrees about z, y points to -x.
    assert (np.array(view.low) + view.high) / 2 == pytest.approx((0.9, 2.05), abs=1e-6)
    assert np.ptp([view.low, view.high], axis=0) == pytest.approx((0.2 + 0.02, 0.1 + 0.02), abs=1e-6)


@pytest.mark.parametrize("turn", [SIDE, OBLIQUE, (-70.0, 55.0)])
@pytest.mark.parametrize("kind", ["box", "sphere", "ellipsoid", "capsule", "cylinder"])
def test_a_view_holds_every_point_of_a_shape_and_no_more(kind: str, turn: tuple[float, float]) -> None:
    size = {"sphere": (0.4,), "capsule": (0.2, 0.5), "cylinder": (0.2, 0.5)}.get(kind, (0.2, 0.5, 0.3))
    direction = torch.nn.functional.normalize(torch.randn(200_000, 3, dtype=torch.float64), dim=-1)
    disc, along = torch.nn.functional.normalize(direction[:, :2], dim=-1), direction[:, 2:].sign()
    points = {
        "box": direction.sign() * torch.tensor((0.2, 0.5, 0.3)),
        "sphere": 0.4 * direction,
        "ellipsoid": torch.tensor((0.2, 0.5, 0.3)) * direction,
        "capsule": 0.2 * direction + 0.5 * along * torch.tensor((0, 0, 1)),
        "cylinder": torch.cat([0.2 * disc, 0.5 * along], -1),
    }[kind]
    turned = torch.nn.functional.normalize(torch.randn(4, dtype=torch.float64), dim=0)
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, turned.numpy())
    axes = View((0, 0), (0, 0), turn).axes
    assert np.linalg.det(axes[[0, 2, 1]]) == pytest.approx(1)
    seen = (points.numpy() @ matrix.reshape(3, 3).T + [0.1, 0.2, 0.3]) @ axes[:2].T
    view = view_of([Shape("it", kind, size, RED)], pose(0.1, 0.2, 0.3, turned)[None], turn)
    low, high = seen.min(0), seen.max(0)
    margin = 0.05 * (high - low).max()
    np.testing.assert_allclose(view.low, low - margin, atol=2e-3)
    np.testing.assert_allclose(view.high, high + margin, atol=2e-3)


def test_what_is_nearer_covers_what_is_farther_in_whatever_order() -> None:
    near, far = Shape("near", "box", (0.1, 0.1, 0.1), RED), Shape("far", "sphere", (0.3,), BLUE)
    poses = torch.cat([pose(y=-1), pose(y=1)])
    for order in ([0, 1], [1, 0]):
        picture = render([(near, far)[i] for i in order], poses[order], size=(99, 99))
        assert picture[49, 49].tolist() == [255, 0, 0]
        assert picture[49, 20].tolist() == [0, 0, 255]
        assert picture[0, 0].tolist() == [255, 255, 255]


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (0.9, 0.9), (-0.9, 0.9), (0.9, -0.9), (-0.9, -0.9)])
def test_what_stands_on_a_table_is_seen_wherever_it_stands(order: list[int], x: float, y: float) -> None:
    table, cup = Shape("table", "box", (1.0, 1.0, 0.4), BLUE), Shape("cup", "cylinder", (0.05, 0.05), RED)
    poses = torch.cat([pose(z=0.4), pose(x=x, y=y, z=0.85 - 1e-4)])  # sunk in by as much as contacts give way
    above = View((-2, -2), (2, 2), OBLIQUE)
    picture = render([(table, cup)[i] for i in order], poses[order], size=(200, 200), view=above)
    assert (picture == (255, 0, 0)).all(-1).sum() > 10
    below = View((-2, -2), (2, 2), (25.0, -20.0))
    picture = render([(table, cup)[i] for i in order], poses[order], size=(200, 200), view=below)
    assert y < 0 or not (picture == (255, 0, 0)).all(-1).any()  # at the near edge it looks over


def test_right_is_x_and_up_is_z_and_a_positive_angle_leans_towards_x() -> None:
    rod = Shape("rod", "capsule", (0.05, 1.0), RED)
    one = torch.ones(1).double()
    picture = render([rod], planar(0 * one, 0 * one, 0.6 * one), size=(90, 90), view=View((-1.5, -1.5), (1.5, 1.5)))
    ink = np.argwhere((picture == (255, 0, 0)).all(-1))
    top, bottom = ink[ink[:, 0] < 30], ink[ink[:, 0] > 60]
    assert top[:, 1].mean() > 50
    assert bottom[:, 1].mean() < 40


def test_a_ghost_is_pale_and_behind_and_transparency_lets_paper_through() -> None:
    ball = Shape("ball", "sphere", (0.2,), RED)
    ghost = ([Shape("ghost", "sphere", (0.2,), BLUE)], pose(x=0.2, y=-5))
    view = View((-0.5, -0.5), (0.5, 0.5))
    picture = render([ball], pose(), size=(100, 100), view=view, ghost=ghost)
    assert picture[50, 60].tolist() == [255, 0, 0]
    assert picture[50, 85].tolist() == [191, 191, 255]
    glass = render([Shape("ball", "sphere", (0.2,), (1.0, 0.0, 0.0, 0.0))], pose(), size=(100, 100), view=view)
    assert (glass == 255).all()


def test_a_mesh_shows_the_faces_that_look_at_the_viewer() -> None:
    corners = torch.tensor([[-1, 0, -1], [1, 0, -1], [0, 0, 1]]).double()
    view = View((-1.5, -1.5), (1.5, 1.5))
    for faces, seen in (([[0, 1, 2]], True), ([[0, 2, 1]], False)):
        shape = Shape("mesh", "mesh", (), RED, vertices=corners, faces=torch.tensor(faces))
        assert ((render([shape], pose(), size=(30, 30), view=view) < 255).any()) == seen


def test_a_picture_of_one_state_shows_the_tasks_goal() -> None:
    simulator, task = arm(), ReachTask()
    theta = simulator.nominal
    begun = task.start(theta[None], torch.Generator().manual_seed(0))
    shapes, poses = scene((simulator, task), theta, begun)
    assert shapes[-1].name == "goal"
    torch.testing.assert_close(poses[0, -1, :3], begun["task", "goal"][0])
    bare, _ = scene((simulator, object()), theta, begun)
    assert bare == shapes[:-1]
    picture = render_state((simulator, task), theta, begun[0], view=view_of(shapes, poses, OBLIQUE))
    green = (picture == np.round(255 * np.array(shapes[-1].colour[:3]))).all(-1)
    assert picture.shape == (240, 320, 3)
    assert 5 < green.sum() < 400
    empty, none = scene((object(),), theta, begun)
    assert not empty
    assert none.shape == (1, 0, 7)
    assert (render(empty, none[0], size=(20, 30)) == 255).all()


def test_motion_in_a_plane_is_seen_from_the_side_any_other_aslant() -> None:
    for simulator, turn in ((hopper(), SIDE), (arm(), OBLIQUE), (Pendulum(), SIDE)):
        some = states(simulator)
        shapes, poses = simulator.shapes(simulator.nominal), simulator.poses(simulator.nominal, some)
        assert view_of(shapes, poses).turn == turn


def test_a_textured_ground_has_its_textures_mean_colour() -> None:
    spec = mujoco.MjSpec.from_string(
        """<mujoco><asset>
          <texture name="grid" type="2d" builtin="flat" rgb1=".2 .4 .6" width="8" height="8"/>
          <material name="grid" texture="grid" rgba="1 1 .5 1"/>
        </asset><worldbody>
          <geom type="plane" size="1 1 .1" material="grid"/>
          <geom type="sphere" size=".1" rgba=".1 .2 .3 1"/>
        </worldbody></mujoco>"""
    )
    ground, ball = mujoco_drawing.shapes(spec.compile())
    assert ground.colour == pytest.approx((0.2, 0.4, 0.3, 1.0), abs=0.01)
    assert ball.colour == pytest.approx((0.1, 0.2, 0.3, 1.0))


def test_a_fine_mesh_is_drawn_with_few_faces() -> None:
    text = """<mujoco><asset><mesh name="ball" builtin="sphere" params="4"/></asset>
    <worldbody><body><geom type="mesh" mesh="ball"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    assert model.nmeshface > 2000
    (ball,) = mujoco_drawing.shapes(model)
    assert ball.faces is not None
    assert ball.vertices is not None
    assert 100 < len(ball.faces) <= mujoco_drawing.FACES
    assert int(ball.faces.max()) < len(ball.vertices)
    radius = ball.vertices.norm(dim=-1)
    assert 0.9 < float(radius.min()) <= float(radius.max()) <= 1.001
