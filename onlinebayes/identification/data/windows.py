"""The fit runs cut into windows of one horizon, each with its smoothed start: everything a replay is compared with.

    window w: rows g_w+1 .. g_w+K of a run, driven by the commands of intervals g_w .. g_w+K-1, from (q0, v0) at row g_w

Rows are averaged into n bins of at most H / 100. Starts are nuisances, not measurements: they carry the priors of
:mod:`.start_priors`. A joint that moves less than 8 sensor sd in a window
starts at the window's median, at rest, is not freed, and its signals are not scored there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from onlinebayes.identification.data.coordinates import rotations, velocity
from onlinebayes.identification.data.grid import RunGrid, replay_step, run_grids
from onlinebayes.identification.data.motion import check_seen
from onlinebayes.identification.data.run_history import RunHistory
from onlinebayes.identification.data.start_priors import StartPriors, coordinates_of, start_priors
from onlinebayes.identification.data.tiling import Tiling, tile
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.abilities import Measured
from onlinebayes.simulators.identifiable import Identifiable

MEMORY = 20.0  # horizons before a window whose commands are kept for hidden states


Span = tuple[str, float, float]
"""The place of a window: its run, and the instants between which it lies [s]."""


@dataclass(frozen=True)
class Windows:
    """W windows of K rows; U commands, S signals, J joints, n = K / bin_rows bins.

    Args:
        step: row spacing h [s].
        bin_rows: rows averaged into one bin.
        run, first: number of the run and the grid row at which each window starts.
        command, enable: during the window.
        history, history_enable: during the Q rows before it (where the run began later, the command of its first row
            or, of a machine that was idle before, none; actuators off).
        value, observed: the signals at the rows after the start [SI]; the rows of still joints count as not observed.
        measured, inside: what was measured, still or not, and which rows lie within the run and before its next gap.
        start, start_sd: (q0 of the J joints, v0 of the J joints) and their sd [SI].
        start_prior: sd within which the starts may move about them [SI]; 0 where they are known exactly.
        start_given: where that is what the user knows, not what the smoother says.
        free: which joints move in the window.
        noise: floor of each signal [SI].
        columns: the S signals' places among the simulator's signals.
        runs, begin: names of the runs, and the instants of their first rows [s].
        run_histories: how each of the runs moved before its windows; none where that is not at hand.
        late: how many rows after its row each value was measured (-1/2 to 1/2); None where all were at rows.
    """

    step: float
    bin_rows: int
    run: Int[Tensor, " W"]
    first: Int[Tensor, " W"]
    command: Float[Tensor, "W K U"]
    enable: Float[Tensor, "W K U"]
    history: Float[Tensor, "W Q U"]
    history_enable: Float[Tensor, "W Q U"]
    value: Float[Tensor, "W K S"]
    observed: Bool[Tensor, "W K S"]
    measured: Bool[Tensor, "W K S"]
    inside: Bool[Tensor, "W K"]
    start: Float[Tensor, "W J2"]
    start_sd: Float[Tensor, "W J2"]
    start_prior: Float[Tensor, "W J2"]
    start_given: Bool[Tensor, "W J2"]
    free: Bool[Tensor, "W J"]
    noise: Float[Tensor, " S"]
    columns: tuple[int, ...]
    runs: tuple[str, ...]
    begin: tuple[float, ...]
    run_histories: tuple[RunHistory, ...] = ()
    late: Float[Tensor, "W K S"] | None = None

    @property
    def count(self) -> int:
        """Number of windows W."""
        return self.value.shape[0]

    @property
    def rows(self) -> int:
        """Rows of a window K."""
        return self.value.shape[1]

    @property
    def bins(self) -> int:
        """Bins of a window n."""
        return self.rows // self.bin_rows

    @property
    def bin_step(self) -> float:
        """Length of a bin Delta [s]."""
        return self.step * self.bin_rows

    @property
    def horizon(self) -> float:
        """Length of a window H [s]."""
        return self.step * self.rows

    @property
    def spans(self) -> tuple[Span, ...]:
        """The place of each window; windows of other tables, steps or signals that lie there have the same one."""
        places = zip(self.run.tolist(), self.first.tolist(), strict=True)
        begins = [(self.runs[r], self.begin[r] + self.step * g) for r, g in places]
        return tuple((run, round(begin, 6), round(begin + self.horizon, 6)) for run, begin in begins)

    @property
    def seen(self) -> Bool[Tensor, "W n S"]:
        """Mask of the bins that hold an observation."""
        return self.observed.unflatten(1, (self.bins, self.bin_rows)).any(2)

    @property
    def moving(self) -> Bool[Tensor, " W"]:
        """Mask of the windows that hold an observation that is scored: in the others all joints rest."""
        return self.observed.any(2).any(1)

    @property
    def free_starts(self) -> Bool[Tensor, "W J2"]:
        """Mask of the entries of the starts that move: both of a joint that does, but for what is known exactly."""
        return torch.cat([self.free, self.free], -1) & (self.start_prior > 0)

    @property
    def bin_noise(self) -> Float[Tensor, "W n S"]:
        """Sensor noise of each bin's average [SI]; of one row where nothing was observed."""
        count = self.observed.unflatten(1, (self.bins, self.bin_rows)).sum(2).clamp_min(1)
        return self.noise / count.sqrt()

    def bin(self, rows: Float[Tensor, "*batch W K S"]) -> Float[Tensor, "*batch W n S"]:
        """Average of the observed rows of each bin, 0 where there is none."""
        weight = self.observed.to(rows.dtype).unflatten(1, (self.bins, self.bin_rows))
        grouped = rows.unflatten(-2, (self.bins, self.bin_rows))
        return (grouped * weight).sum(-2) / weight.sum(-2).clamp_min(1.0)

    def select(self, index: Int[Tensor, " V"]) -> Windows:
        """Some of the windows."""
        names = (
            *("run", "first", "command", "enable", "history", "history_enable"),
            *("value", "observed", "measured", "inside"),
            *("start", "start_sd", "start_prior", "start_given", "free"),
            *(() if self.late is None else ("late",)),
        )
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    def of_runs(self, names: Sequence[str]) -> Windows:
        """Select the windows of some runs, as windows of a measurement of these runs alone.

        Args:
            names: of runs, in the order of that measurement.
        """
        numbers = [self.runs.index(name) for name in names]
        place = torch.full((len(self.runs),), -1, dtype=self.run.dtype, device=self.run.device)
        place[numbers] = torch.arange(len(names), dtype=self.run.dtype, device=self.run.device)
        mine = self.select((place[self.run] >= 0).nonzero()[:, 0])
        histories = tuple(self.run_histories[r] for r in numbers) if self.run_histories else ()
        begin = tuple(self.begin[r] for r in numbers)
        return replace(mine, run=place[mine.run], runs=tuple(names), begin=begin, run_histories=histories)


def joint_names(simulator: Measured) -> tuple[str, ...]:
    """The simulator's joint coordinates, each of which must have one position and one velocity.

    Raises:
        BadInput: a free or ball joint whose orientation is a quaternion still (see :mod:`.replaying.charted`).
    """
    positions = [name.removeprefix("qpos.") for name in simulator.signals if name.startswith("qpos.")]
    if quaternions := rotations(simulator.signals):
        raise BadInput(
            f"joint '{quaternions[0].joint}' is a free or ball joint", "only compare, diagnose and refine take it"
        )
    for name in positions:
        if velocity(name, simulator.signals) is None:
            raise BadInput(f"joint '{name}' has no single velocity", f"give the simulator a signal qvel.{name}")
    return tuple(positions)


def make_windows(
    simulator: Identifiable,
    measurement: Measurement,
    horizon: float,
    memory: float = 0.0,
    noise: Float[Tensor, " S"] | None = None,
    like: Windows | None = None,
    inset: bool = False,
) -> Windows:
    """Tile every run with windows of ``horizon`` seconds.

    Args:
        simulator: what will replay them; gives the integration step, the joints and the order of commands.
        measurement: the runs.
        horizon: H [s]; shortened to the longest run.
        memory: seconds of commands that a hidden state remembers.
        noise: floor of each signal [SI], or None to take it from these runs.
        like: windows of the same runs whose instants, starts and noise are kept, on this simulator's own rows or
            the next coarser that divide theirs; its timestep divides their step.
        inset: begin each run's first window where the smoother sees it from both sides, for replays that take starts as
            measured: read off a run's end, a velocity is four times as uncertain.

    Raises:
        BadInput: a joint that no signal shows, an unknown signal, a command that is missing, a known start of a
            coordinate that is not there.
    """
    measurement = _in_order(simulator, measurement)
    step = replay_step(measurement, simulator.timestep)
    if like is not None:
        step = _whole_part(like.step, step, simulator.timestep)
    grids = run_grids(measurement, step)
    if like is None:
        joints, memory_span = joint_names(simulator), simulator.memory_span
        tiling = tile(measurement, grids, joints, horizon, noise, inset, memory_span)
        first = torch.tensor([row == 0 for _, row in tiling.places], device=tiling.start.device)
        coordinates = coordinates_of(joints, simulator.signals)
        starts = start_priors(tiling.start, tiling.start_sd, first, coordinates, measurement.starts)
    else:
        tiling = _tiled_like(like, step)
        starts = StartPriors(like.start, like.start_prior, like.start_sd, like.start_given)
    return _gather(simulator, measurement, grids, tiling, starts, max(0, round(memory / step)))


def _tiled_like(like: Windows, step: float) -> Tiling:
    """The same windows on rows of another spacing [s]."""
    finer = round(like.step / step)
    places = tuple((r, g * finer) for r, g in zip(like.run.tolist(), like.first.tolist(), strict=True))
    return Tiling(places, like.rows * finer, like.bin_rows * finer, like.start, like.start_sd, like.free, like.noise)


def _gather(
    simulator: Measured,
    measurement: Measurement,
    grids: tuple[RunGrid, ...],
    tiling: Tiling,
    starts: StartPriors,
    history: int,
) -> Windows:
    """Everything that the windows of a tiling hold, ``history`` rows of commands before each included."""
    names = tuple(signal.name for signal in measurement.signals)
    index = torch.tensor(tiling.places, device=tiling.start.device)
    of_run = [(index[:, 0] == r).nonzero()[:, 0] for r in range(len(grids))]
    cut = [
        _cut(grids[r], index[some, 1], tiling.rows, history, measurement.idle_before)
        for r, some in enumerate(of_run)
        if len(some)
    ]
    back = torch.cat(of_run).argsort()
    command, enable, past, past_enable, value, measured, inside, late = (
        torch.cat(part)[back] for part in zip(*cut, strict=True)
    )
    observed = measured.clone()
    for j, joint in enumerate(joint_names(simulator)):
        for s, name in enumerate(names):
            if name in (f"qpos.{joint}", velocity(joint, simulator.signals)):
                observed[:, :, s] &= tiling.free[:, j : j + 1]
    return Windows(
        step=grids[0].step,
        bin_rows=tiling.bin_rows,
        run=index[:, 0],
        first=index[:, 1],
        command=command,
        enable=enable,
        history=past,
        history_enable=past_enable,
        value=value,
        observed=observed,
        measured=measured,
        inside=inside,
        start=starts.mean,
        start_sd=starts.uncertainty,
        start_prior=starts.sd,
        start_given=starts.given,
        free=tiling.free,
        noise=tiling.noise,
        columns=tuple(simulator.signals.index(name) for name in names),
        runs=measurement.runs,
        begin=tuple(grid.start for grid in grids),
        run_histories=tuple(RunHistory(measurement, grid, joint_names(simulator)) for grid in grids),
        late=late if bool(late.any()) else None,
    )


def _in_order(simulator: Identifiable, measurement: Measurement) -> Measurement:
    """The measurement with the simulator's commands in the simulator's order, its signals checked."""
    for signal in measurement.signals:
        if signal.name not in simulator.signals:
            cure = nearest(signal.name, simulator.signals, cutoff=0.3)
            raise BadInput(f"the simulator has no signal '{signal.name}'", cure)
    check_seen(simulator, joint_names(simulator), [signal.name for signal in measurement.signals])
    for name in simulator.commands:
        if name not in measurement.commands:
            raise BadInput(f"no command for actuator '{name}'", f"add the column ctrl.{name}")
    order = [measurement.commands.index(name) for name in simulator.commands]
    data = measurement.data.clone(recurse=False)
    data["command"], data["enable"] = data["command"][..., order], data["enable"][..., order]
    return replace(measurement, data=data, commands=tuple(simulator.commands))


def _whole_part(whole: float, about: float, timestep: float) -> float:
    """The spacing [s] next above ``about`` that divides ``whole`` and is a whole number of timesteps."""
    steps = round(whole / timestep)
    most = max(1, int(whole / about + 1e-6))
    return whole / max(parts for parts in range(1, most + 1) if steps % parts == 0)


def _cut(grid: RunGrid, first: Int[Tensor, " V"], rows: int, history: int, idle: bool) -> tuple[Tensor, ...]:
    """What V windows of one run hold, each of whose first rows is given."""
    pieces = torch.tensor([*grid.pieces, (grid.rows + 1, grid.rows)], device=first.device)
    at = torch.searchsorted(pieces[:, 0].contiguous(), first, right=True) - 1
    # Rows before the first piece belong to none: the whole run, then.
    begin = torch.where(at >= 0, pieces[at.clamp_min(0), 0], 0)[:, None]
    end = torch.where(at >= 0, pieces[at.clamp_min(0), 1], grid.rows)[:, None]
    during = first[:, None] + torch.arange(rows, device=first.device)
    held = during.minimum(end)
    before = first[:, None] + torch.arange(-history, 0, device=first.device)
    began, before = before >= 0, before.maximum(begin)
    past = grid.command[before]
    inside = during + 1 <= end
    after = (during + 1).minimum(end)
    value = (grid.value if grid.reading is None else grid.reading)[after]
    return (
        grid.command[held],
        grid.enable[held],
        torch.where(began[..., None], past, torch.zeros_like(past)) if idle else past,
        grid.enable[before] * began[..., None].to(grid.enable),
        value,
        grid.observed[after] & inside[..., None],
        inside,
        torch.zeros_like(value) if grid.late is None else grid.late[after],
    )
