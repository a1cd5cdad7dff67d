"""Replay a log through a simulator, fit the parameters, and say which directions the data determine.

    windows = make_windows(simulator, measurement, horizon)     # stretches of the log, each with a smoothed start
    fitted = fit(simulator, windows, simulator.nominal)         # starts projected out, damped least squares
    simulated = replay(simulator, windows, fitted.theta[None])
    flat_directions(fitted, ...), estimates(...)                # what the data say, and what they do not

Criticism and inference both stand on it. ``data`` cuts runs into windows, ``replaying`` plays them, ``fitting`` fits.
Users outside import from here; criticism uses the inner rooms until its search is replaced.
"""

from onlinebayes.identification.data import rotations
from onlinebayes.identification.data.coordinates import AXES
from onlinebayes.identification.data.grid import RunGrid, row_step, run_grids
from onlinebayes.identification.data.motion import seen_by
from onlinebayes.identification.data.noise import measured_floors, noise_floors
from onlinebayes.identification.data.start_priors import start_coordinates
from onlinebayes.identification.data.windows import MEMORY, Windows, joint_names, make_windows
from onlinebayes.identification.detail import Detail, HorizonError, Profile, WindowError
from onlinebayes.identification.fitting.blocks import FEWEST_BLOCKS, make_blocks
from onlinebayes.identification.fitting.closed_loops import completed, follow
from onlinebayes.identification.fitting.fit import Fit, residual_correlation_time, weighed_by_noise
from onlinebayes.identification.fitting.gauss_newton import SETTLED, Fitted, fit
from onlinebayes.identification.fitting.heldout import begun_best, replay_error, replay_runs, start_floor, start_spread
from onlinebayes.identification.fitting.horizon import steady
from onlinebayes.identification.fitting.identifiability import estimates, flat_directions, rests_on_moments
from onlinebayes.identification.fitting.projection import Projected, noise_rows, project, signal_rms
from onlinebayes.identification.fitting.rows import BANDS, band_counts, band_squares, left_of
from onlinebayes.identification.fitting.sensitivities import columns, linearise
from onlinebayes.identification.fitting.window_length import fit_base
from onlinebayes.identification.fleet import Fleet, fleet_of
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator
from onlinebayes.identification.judging.rule import LEAST_GAIN
from onlinebayes.identification.replaying.charted import charted
from onlinebayes.identification.replaying.clock import in_step
from onlinebayes.identification.replaying.forces import EffectForce, effect_forces
from onlinebayes.identification.replaying.integration import Integration, reported
from onlinebayes.identification.replaying.measured_starts import windows_to_replay
from onlinebayes.identification.replaying.replay import replay, replay_binned, rollout, sensor_readings
from onlinebayes.identification.replaying.scoped import ScopedSimulator, physical
from onlinebayes.identification.replaying.wrapper import unwrap
from onlinebayes.identification.results import Estimate, FittedModel, FlatDirection, Numerics, ReplayedRun, Selection
from onlinebayes.identification.scope import Scope, address_of
from onlinebayes.identification.splitting import split

__all__ = [
    "AXES",
    "BANDS",
    "FEWEST_BLOCKS",
    "LEAST_GAIN",
    "MEMORY",
    "SETTLED",
    "Detail",
    "EffectForce",
    "Estimate",
    "Evaluation",
    "Evaluator",
    "Fit",
    "Fitted",
    "FittedModel",
    "FlatDirection",
    "Fleet",
    "HorizonError",
    "Integration",
    "Numerics",
    "Profile",
    "Projected",
    "ReplayedRun",
    "RunGrid",
    "Scope",
    "ScopedSimulator",
    "Selection",
    "WindowError",
    "Windows",
    "address_of",
    "band_counts",
    "band_squares",
    "begun_best",
    "charted",
    "columns",
    "completed",
    "effect_forces",
    "estimates",
    "fit",
    "fit_base",
    "flat_directions",
    "fleet_of",
    "follow",
    "in_step",
    "joint_names",
    "left_of",
    "linearise",
    "make_blocks",
    "make_windows",
    "measured_floors",
    "noise_floors",
    "noise_rows",
    "physical",
    "project",
    "replay",
    "replay_binned",
    "replay_error",
    "replay_runs",
    "reported",
    "residual_correlation_time",
    "rests_on_moments",
    "rollout",
    "rotations",
    "row_step",
    "run_grids",
    "seen_by",
    "sensor_readings",
    "signal_rms",
    "split",
    "start_coordinates",
    "start_floor",
    "start_spread",
    "steady",
    "unwrap",
    "weighed_by_noise",
    "windows_to_replay",
]
