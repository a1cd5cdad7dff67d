"""The held-out error of the model as its engine's own file holds it: without what such a file has no term for."""

from __future__ import annotations

from collections.abc import Mapping

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.heldout import begun_best, replay_error, replay_runs
from onlinebayes.identification.replaying.scoped import ScopedSimulator, physical, unscoped
from onlinebayes.identification.replaying.wrapper import SimulatorWrapper, unwrap
from onlinebayes.identification.results import FittedModel
from onlinebayes.simulators.identifiable import Identifiable


def error_of_file(final: FittedModel, held: Windows | None, after: Mapping[str, float]) -> dict[str, float]:
    """RMS over the held-out windows, each from its best start [the signal's unit]; inf where it diverges.

    Args:
        final: the model.
        held: windows of the held-out runs; None where these could not be replayed.
        after: its own error, which is the file's where that is all of it; signals in the windows' order.

    Returns:
        Signal -> error; empty where that is not known, or the engine has no files.
    """
    theta = physical(final.simulator, final.theta)
    found = unwrap(final.simulator).in_file(theta)
    if held is None or found is None or not isinstance(found.simulator, Identifiable):
        return {}
    if not (found.without or found.integrated or isinstance(final.simulator, ScopedSimulator)):
        return dict(after)
    given = unscoped(final.simulator)
    bare = given.around(found.simulator) if isinstance(given, SimulatorWrapper) else found.simulator
    windows = begun_best(bare, held, found.theta, held_out=True)
    return replay_error(replay_runs(bare, windows, found.theta, held_out=True), tuple(after))
