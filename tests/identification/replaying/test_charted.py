"""Quaternions become turns and come back; what is scalar passes through."""

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism.wiring.possible import possible_faults
from onlinebayes.identification.data.chart import positions, turns
from onlinebayes.identification.data.coordinates import rotations, velocity
from onlinebayes.identification.data.windows import Windows, joint_names, make_windows
from onlinebayes.identification.replaying.charted import charted
from onlinebayes.identification.replaying.replay import replay, rollout
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_simulator
from tests.criticism import rigs
from tests.criticism.tumbling import BLOCK, FREE, POSE, TRUTH, Block, measure, measurement, model, table

CHAIN = """
<mujoco><option timestep="0.01" integrator="RK4"/><worldbody><body>
  <joint name="rail" type="slide" stiffness="10"/><geom size=".1"/>
  <body pos="0 0 .3"><joint name="wrist" type="ball"/><geom size=".1" pos="0 0 .2"/>
    <body pos="0 0 .5"><joint name="tip" type="hinge" axis="1 0 0"/><geom size=".1" pos="0 0 .2"/></body></body>
</body><body pos="9 0 0"><freejoint name="ball"/><geom size=".1"/></body></worldbody></mujoco>"""
TRUE = torch.tensor([TRUTH], dtype=torch.float64)


def wandering(simulator: MujocoSimulator, runs: int = 2, rows: int = 101) -> TensorDict:
    """Trajectories (runs, rows) from random velocities."""
    state = simulator.with_worlds(runs).state.select("qpos", "qvel")
    state["qvel"] = 2 * torch.randn_like(state["qvel"])
    times = torch.arange(rows, dtype=torch.float64) * simulator.timestep
    inputs = TensorDict({"command": torch.zeros(runs, rows, 0)}, batch_size=(runs, rows))
    return simulator.rollout(torch.zeros(runs, 0, dtype=torch.float64), state, inputs, times)


def recorded(simulator: MujocoSimulator, trajectory: TensorDict) -> Measurement:
    names = [name for name in simulator.signals if name.startswith("qpos.")]
    time = simulator.timestep * np.arange(trajectory.batch_size[1])
    runs = {
        f"run{r}": {"time": time, **dict(zip(names, qpos.numpy().T, strict=True))}
        for r, qpos in enumerate(trajectory["qpos"])
    }
    return Measurement.from_runs(runs, commands=[])


def at_truth(windows: Windows, starts: torch.Tensor | None = None) -> torch.Tensor:
    simulator, _ = charted(model(), measure(Block(), runs=2, noise=1e-9))
    signals, valid = replay(simulator, windows, TRUE, windows.start[None] if starts is None else starts)
    assert bool(valid.all())
    return signals[0]


def test_names_and_their_velocities() -> None:
    simulator = MujocoSimulator(CHAIN, threads=1)
    wrist, ball = rotations(simulator.signals)
    assert (wrist.joint, wrist.first, wrist.linear) == ("wrist", 1, ())
    assert (ball.joint, ball.first, ball.linear) == ("ball", 9, ("ball.0", "ball.1", "ball.2"))
    chart, turned = charted(simulator, recorded(simulator, wandering(simulator)))
    joints = joint_names(chart)
    assert joints[:5] == ("rail", "wrist.rx", "wrist.ry", "wrist.rz", "tip")
    assert joints[5:] == ("ball.0", "ball.1", "ball.2", "ball.rx", "ball.ry", "ball.rz")
    rates = [velocity(joint, chart.signals) for joint in joints]
    assert rates == [name for name in chart.signals if name.startswith("qvel.")]
    assert [signal.name for signal in turned.signals] == [f"qpos.{joint}" for joint in joints]
    assert {turned.signals[k].unit for k in (1, 2, 3, 8, 9, 10)} == {"rad"}
    assert chart.targets("joint") == ("rail", "tip")
    assert "qpos.ball.3" not in chart.targets("signal")


def test_it_is_a_simulator() -> None:
    mass = FREE.subspace(["body.block.mass"])
    simulator, _ = charted(MujocoSimulator(BLOCK, mass, worlds=3, threads=1), measure(Block(), runs=1))
    check_simulator(simulator)


def test_slides_with_dotted_names_are_no_ball_joint() -> None:
    assert rotations([f"{kind}.a.{k}" for kind in ("qpos", "qvel") for k in range(4)]) == ()


def test_where_all_joints_are_scalar_nothing_is_touched() -> None:
    simulator, measured = rigs.model(), rigs.measure(runs=2)
    assert charted(simulator, measured) == (simulator, measured)


def test_the_chart_is_undone_and_leaves_scalars_bit_for_bit() -> None:
    simulator = MujocoSimulator(CHAIN, threads=1)
    turning, qpos = rotations(simulator.signals), wandering(simulator)["qpos"]
    quaternion = torch.stack([wandering(simulator)["qpos"][..., r.first : r.first + 4] for r in turning], -2)
    turn = torch.randn(2, 101, 2, 3, dtype=torch.float64)
    turned = turns(turning, qpos, quaternion, turn)
    back = positions(turning, turned, quaternion, turn)
    scalar = [0, 5, 6, 7, 8]
    assert torch.equal(turned[..., [0, 4, 5, 6, 7]], qpos[..., scalar])
    assert torch.equal(back[..., scalar], qpos[..., scalar])
    sign = torch.ones_like(qpos)
    for r in turning:
        part = slice(r.first, r.first + 4)
        sign[..., part] = (back[..., part] * qpos[..., part]).sum(-1, keepdim=True).sign()
    assert torch.allclose(sign * back, qpos, atol=1e-12)


def test_a_replay_from_the_smoothed_starts_is_the_measurement() -> None:
    """From the block's own equations: names, axes, signs and the order of products, all in one."""
    simulator, turned = charted(model(), measure(Block(), runs=2, noise=1e-9))
    windows = make_windows(simulator, turned, 1.0)
    wrong = windows.value - at_truth(windows)
    # What a cubic over seven rows makes of a start, carried on for a second.
    assert float(wrong.abs().max()) < 5e-3
    assert float(windows.value[..., 3:].abs().max()) > 3.2  # beyond half a turn


def test_residuals_are_the_tangent_errors() -> None:
    import mujoco

    simulator, turned = charted(model(), measure(Block(), runs=1, noise=1e-2))
    windows = make_windows(simulator, turned, 1.0)
    path = rollout(simulator, windows, TRUE, windows.start[None])[0]
    poses = table(Block(), runs=1, noise=1e-2)["run0"]
    for w in range(windows.count):
        for k in range(0, windows.rows, 25):
            row = int(windows.first[w]) + k + 1
            measured = np.array([poses[name][row] for name in POSE])
            measured[3:] /= np.linalg.norm(measured[3:])
            away = np.zeros(6)
            mujoco.mj_differentiatePos(simulator.physics.model, away, 1.0, measured, path["pose"][w, k].numpy())
            assert np.allclose(path["qpos"][w, k] - windows.value[w, k], away, atol=1e-12)


def test_opposite_quaternions_are_the_same_measurement() -> None:
    flown = table(Block(), runs=1)
    flipped = {run: dict(columns) for run, columns in flown.items()}
    sign = np.where(np.random.default_rng(0).random(301) < 0.5, -1.0, 1.0)
    for name in POSE[3:]:
        flipped["run0"][name] = sign * flipped["run0"][name]
    found = []
    for runs in (flown, flipped):
        simulator, turned = charted(model(), measurement(runs))
        windows = make_windows(simulator, turned, 1.0)
        found.append((windows.value, windows.start, replay(simulator, windows, TRUE, windows.start[None])[0]))
    for one, other in zip(*found, strict=True):
        assert torch.equal(one, other)


def test_one_replay_of_many_is_the_replay_of_one() -> None:
    simulator, turned = charted(model(), measure(Block(), runs=2))
    windows = make_windows(simulator, turned, 1.0)
    thetas = TRUE * torch.tensor([[1.0], [0.8], [1.2]], dtype=torch.float64)
    starts = windows.start + 0.01 * torch.randn(3, *windows.start.shape, dtype=torch.float64)
    together, _ = replay(simulator, windows, thetas, starts)
    for k in range(3):
        alone, _ = replay(simulator, windows, thetas[k : k + 1], starts[k : k + 1])
        assert torch.equal(together[k], alone[0])
    some = torch.tensor([3, 1])
    few, _ = replay(simulator, windows.select(some), thetas, starts[:, some])
    assert torch.equal(few, together[:, some])


def test_of_an_orientation_only_the_velocity_may_be_wired_wrongly() -> None:
    runs = table(Block(), runs=1, seconds=1.0)
    runs["run0"] |= {f"qvel.pose.{k}": np.zeros(101) for k in range(3, 6)}
    measured = Measurement.from_runs(runs, commands=["thruster"])
    lines = [fault.lines for fault in possible_faults(*charted(model(), measured))]
    assert not any(".rx" in line or ".ry" in line or ".rz" in line for line in lines)
    assert '[signals."qpos.pose.0"]\nsign = -1' in lines
    assert "\n".join(f'[signals."qvel.pose.{k}"]\nscale = 0.0174532925' for k in range(3, 6)) in lines


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.pop("qpos.pose.5"), "qpos.pose.5"),
        (lambda t: [t.pop(name) for name in POSE[3:]], "joint 'pose' has no measured orientation"),
        (lambda t: t.pop("qpos.pose.1"), "joint 'pose.1' has no measured position"),
        (lambda t: t.update({"qpos.pose.3": 1.2 + t["qpos.pose.3"]}), "a quaternion of norm"),
        (lambda t: t["qpos.pose.4"].__setitem__(7, np.nan), "row 8"),
        (lambda t: [t[name].fill(np.nan) for name in POSE[3:]], "run 'run0'"),
    ],
)
def test_bad_orientations_are_refused(change, message: str) -> None:
    runs = table(Block(), runs=1, seconds=1.0)
    change(runs["run0"])
    with pytest.raises(BadInput, match=message):
        make_windows(*charted(model(), Measurement.from_runs(runs, commands=["thruster"])), 0.5)
