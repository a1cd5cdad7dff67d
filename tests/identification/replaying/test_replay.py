import pytest
import torch

from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, SLIDE, TRUTH, measure, model

MOTOR = '<motor name="motor" joint="rail"/>'
FILTER = '<general name="motor" joint="rail" dyntype="filter" dynprm="0.3"/>'
MUSCLE = '<general name="motor" joint="rail" dyntype="muscle" dynprm="0.1 0.3 0"/>'
DC_MOTOR = (
    '<dcmotor name="motor" joint="rail" motorconst="0.05" resistance="2.0" inductance="0.001" nominal="12 0.1 100"/>'
)

DELAY = ActuatorDelay("motor", Parameter(0.0, 0.1, "s"))


def largest_error(memory: float) -> float:
    """Of the replay at the truth, a delay of 70 ms included, over windows that begin in the middle of runs."""
    simulator = model().with_effect(DELAY)
    windows = make_windows(simulator, measure({DELAY: (0.07,)}, runs=2, noise=1e-9), 1.0, memory)
    windows = windows.select((windows.first > 0).nonzero()[:, 0])
    theta = torch.tensor([*TRUTH, 0.07]).double()
    signals, valid = replay(simulator, windows, theta[None], windows.start[None])
    assert bool(valid.all())
    return float((windows.value - signals[0]).abs().max())


def test_a_delays_buffer_holds_what_was_commanded_before_the_window() -> None:
    assert largest_error(0.1) < 5e-4  # what the smoother makes of starts between two steps of the command
    assert largest_error(0.0) > 1e-2  # an empty buffer is a window without a command at first


def test_one_replay_of_many_is_the_replay_of_one() -> None:
    simulator = model()
    windows = make_windows(simulator, measure(runs=2, seconds=2.0), 1.0)
    thetas = torch.tensor([[2.0, 1.0], [3.0, 0.5], [2.5, 4.0]]).double()
    starts = windows.start + 0.01 * torch.randn(3, *windows.start.shape, dtype=torch.float64)
    together, _ = replay(simulator, windows, thetas, starts)
    for k in range(3):
        alone, _ = replay(simulator, windows, thetas[k : k + 1], starts[k : k + 1])
        assert torch.equal(together[k], alone[0])


def test_a_world_that_diverges_is_flagged_alone() -> None:
    from onlinebayes.parameters import ParameterSpace

    wild = ParameterSpace({"joint.rail.stiffness": Parameter(0.0, 1e9, "N/m")})
    simulator = model(wild)
    windows = make_windows(simulator, measure(runs=2, seconds=2.0), 1.0)
    thetas = torch.tensor([[1.0], [9e8]]).double()
    signals, valid = replay(simulator, windows, thetas, windows.start.expand(2, *windows.start.shape))
    assert valid.all(-1).tolist() == [True, False]
    assert bool(torch.isfinite(signals[0]).all())


@pytest.mark.parametrize(("actuator", "before"), [(FILTER, []), (MUSCLE, [(2, 200)]), (DC_MOTOR, [(4, 200)])])
def test_what_commands_alone_left_behind_is_run_once_for_every_theta(
    monkeypatch: pytest.MonkeyPatch, actuator: str, before: list[tuple[int, int]]
) -> None:
    """A muscle's state is the same from every start, a motor's current is not; a filter's is known without a run."""
    simulator = MujocoSimulator(SLIDE.replace(MOTOR, actuator), FREE, threads=1)
    windows = make_windows(simulator, measure(runs=2), 1.0, 2.0)
    thetas = torch.tensor([[2.0, 1.0], [3.0, 0.5], [2.0, 1.0], [2.0, 1.0]]).double()
    starts = windows.start + 0.01 * torch.randn(4, *windows.start.shape, dtype=torch.float64)
    alone = [replay(simulator, windows, thetas[k : k + 1], starts[k : k + 1])[0][0] for k in range(4)]
    played, rollout = list[tuple[int, int]](), MujocoSimulator.rollout

    def counted(self, theta, state, inputs, times):
        played.append((len(theta) // windows.count, len(times)))
        return rollout(self, theta, state, inputs, times)

    monkeypatch.setattr(MujocoSimulator, "rollout", counted)
    together, _ = replay(simulator, windows, thetas, starts)
    assert played == [*before, (4, windows.rows)]
    for k in range(4):
        assert torch.equal(together[k], alone[k])
