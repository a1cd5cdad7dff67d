"""The system in question, whatever gives its trajectories: an environment, a folder of logs, a robot.

It may have nothing new, fail, or give rubbish. None of this ends a run: what is usable is kept, and a note says why
the rest was left out. What fails in this library's own code is no failure of the system, and is raised.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import torch
from tensordict import TensorDict, TensorDictBase, is_tensor_collection, pad
from torchrl.envs import EnvBase, TransformedEnv

from onlinebayes.runs import BadInput, Stateful, Stopped, one_line
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.trainers.env_state import env_state, load_env_state
from onlinebayes.trainers.trajectories import Policy, TrajectoryFormat, trajectories

REWARD = ("next", "reward")
"""Not every real system gives one, and inference does without."""


@runtime_checkable
class RealSystem(Protocol):
    """The system the physics of which are in question: it runs a policy and gives what its sensors saw."""

    def run(self, policy: Policy, steps: int) -> TensorDict | None:
        """Trajectories of batch size (n, T), with the keys of a simulated one but no theta; None if nothing is new."""


class SystemFailed(Exception):
    """Raised where the code of a user's system, reader or driver raised ``error``.

    Args:
        error: what it raised.
    """

    def __init__(self, error: BaseException) -> None:
        super().__init__(f"{type(error).__name__}: {error}")


def answer(system: RealSystem, policy: Policy, steps: int) -> TensorDict | None:
    """What a real system gives; whoever wraps another one asks it so.

    Raises:
        SystemFailed: a system of somebody else's raised something, or refused its input.
        Exception: a mistake in this library, in one of its own systems.
    """
    try:
        return system.run(policy, steps)
    except (Stopped, SystemFailed):
        raise
    except Exception as error:  # a driver may raise anything
        if type(system).__module__.partition(".")[0] == __package__.partition(".")[0] and not isinstance(
            error, BadInput
        ):
            raise
        raise SystemFailed(error) from error


class RealEnvironment:
    """Any TorchRL environment as the real system: a simulator's, a wrapped Gymnasium environment, a robot's driver.

    Args:
        env: batch size () or (n,).
        form: which keys make up a trajectory.
    """

    __slots__ = ("_foreign", "_load", "_run", "_state")

    def __init__(self, env: EnvBase, form: TrajectoryFormat | None = None) -> None:
        form = form if form is not None else TrajectoryFormat()

        def run(policy: Policy, steps: int) -> TensorDict:
            seen = trajectories(env, policy, steps, form).exclude(form.theta)
            return seen if seen.ndim == 2 else seen.unsqueeze(0)

        self._foreign = not isinstance(env.base_env if isinstance(env, TransformedEnv) else env, SimulatorEnv)
        self._run, self._state, self._load = run, lambda: env_state(env), lambda state: load_env_state(env, state)

    def run(self, policy: Policy, steps: int) -> TensorDict:
        """One trajectory from each world; neither the environment nor its theta can be had from here."""
        try:
            return self._run(policy, steps)
        except Stopped:
            raise
        except Exception as error:  # of a driver, or of TorchRL that cannot use what it gave
            if self._foreign:
                raise SystemFailed(error) from error
            raise

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the environment, for a checkpoint."""
        return self._state()

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Stand there again."""
        self._load(state)


class GrowingFolder:
    """A folder to which something else adds logs; each call gives the trajectories of files that are new.

    Args:
        folder: where the logs appear; it may not exist yet.
        read: file -> trajectory (T,) or trajectories (n, T).
        pattern: of the files' names.
    """

    def __init__(self, folder: str | Path, read: Callable[[Path], TensorDict], pattern: str = "*.csv") -> None:
        self.folder, self.pattern, self._read = Path(folder), pattern, read
        self._seen: set[str] = set()

    def run(self, policy: Policy, steps: int) -> TensorDict | None:
        """Read the new files, padded to one length; a file that cannot be read now is tried again at the next call.

        Raises:
            SystemFailed: none of the new files could be read.
            BadInput: they cannot stand side by side.
        """
        found, unreadable = dict[str, TensorDict](), None
        for path in sorted(self.folder.glob(self.pattern)):
            if path.name in self._seen:
                continue
            try:
                data = self._read(path)
            except Stopped:
                raise
            except Exception as error:  # of the user's reader: whoever writes the file may not have ended yet
                unreadable = error
                continue
            found[path.name] = data if data.ndim == 2 else data.unsqueeze(0)
        if not found and unreadable is not None:
            raise SystemFailed(unreadable) from unreadable
        result = self._beside(found) if found else None
        self._seen |= set(found)
        return result

    def _beside(self, found: Mapping[str, TensorDict]) -> TensorDict:
        """The trajectories of some files.

        Raises:
            BadInput: they have not the same keys and widths.
        """
        try:
            return united(found.values())
        except (RuntimeError, KeyError) as error:  # of torch.cat
            problem = f"{', '.join(found)} cannot stand side by side ({one_line(str(error))[:200]})"
            raise BadInput(problem, "give all logs the same keys and widths", where=str(self.folder)) from error

    def state_dict(self) -> dict[str, Any]:
        """Names of the files that were read."""
        return {"seen": sorted(self._seen)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Do not read these again."""
        self._seen = set(state["seen"])


class Background:
    """A slow real system that delays nothing: it runs beside the learning, and what it saw is picked up later.

    Args:
        system: run in a thread of its own, one call at a time.
    """

    def __init__(self, system: RealSystem) -> None:
        self._system = system
        self._stood: Any = None
        self._thread: threading.Thread | None = None
        self._result: list[TensorDict | BaseException | None] = []

    def run(self, policy: Policy, steps: int) -> TensorDict | None:
        """Return the trajectories of the last call once it has ended; begins the next one where none is under way."""
        if self._thread is not None and self._thread.is_alive():
            return None
        result = self._result.pop() if self._result else None
        self._stood = self._state_of_system()
        self._thread = threading.Thread(target=self._work, args=(policy, steps), daemon=True)
        self._thread.start()
        if isinstance(result, BaseException):
            raise result
        return result

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the system before the call under way, whose trajectories nobody has had yet."""
        return {"system": self._state_of_system() if self._thread is None else self._stood}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Let the system stand there again."""
        if isinstance(self._system, Stateful) and state["system"] is not None:
            self._system.load_state_dict(state["system"])

    def _state_of_system(self) -> Any:
        return self._system.state_dict() if isinstance(self._system, Stateful) else None

    def _work(self, policy: Policy, steps: int) -> None:
        try:
            self._result.append(answer(self._system, policy, steps))
        except BaseException as error:  # raised where its answer is asked for: nobody looks at a thread
            self._result.append(error)


def measured(
    system: RealSystem, policy: Policy, steps: int, form: TrajectoryFormat, before: TensorDict | None = None
) -> tuple[TensorDict | None, str]:
    """Keep the usable part of one call to the system, and note the rest; nothing that it does ends a run.

    Args:
        system: the real system.
        policy, steps: what is asked of it.
        form: which keys a trajectory has; others are left out, a missing reward is zero.
        before: trajectories that the new ones are to stand beside.
    """
    try:
        data = answer(system, policy, steps)
    except SystemFailed as failed:
        return None, one_line(f"the real system failed ({failed}); the belief stays as it was")
    if data is None:
        return None, "the real system gave nothing new; the belief stays as it was"
    if not is_tensor_collection(data) or data.ndim != 2:
        return None, "the real system gave no TensorDict of batch size (n, T); the belief stays as it was"
    keys = [key for key in form.keys if key != REWARD]
    missing = [key for key in keys if data.get(key, None) is None]
    if missing:
        return None, f"the real trajectories lack {missing[0]!r}; the belief stays as it was"
    if flat := [key for key in keys if data.get(key).ndim < 3]:
        shape = tuple(data.get(flat[0]).shape)
        return None, f"{flat[0]!r} of the real trajectories is {shape}, not (n, T, .); the belief stays as it was"
    data = _masked(data).select(*form.keys, "mask", strict=False)
    if REWARD in form.keys and data.get(REWARD, None) is None:
        data[REWARD] = torch.zeros(*data.shape, 1, device=data["mask"].device)
    for key in keys:
        now = tuple(data.get(key).shape[2:])
        was = now if before is None else tuple(before.get(key).shape[2:])
        if was != now:
            return None, f"{key!r} of the real trajectories is {now}, it was {was} before; the belief stays as it was"
    return _usable(data, keys)


def _usable(data: TensorDict, keys: Iterable[Any]) -> tuple[TensorDict | None, str]:
    """The trajectories with at least one step and finite values in every step."""
    mask = data["mask"]
    finite = torch.ones(data.shape[:1], dtype=torch.bool, device=mask.device)
    for key in keys:
        values = data.get(key).double().flatten(2)
        finite &= (torch.isfinite(values).all(-1) | ~mask).all(-1)
    keep = finite & mask.any(-1)
    if bool(keep.all()):
        return data, ""
    empty, broken = int((~mask.any(-1)).sum()), int((~finite).sum())
    note = f"left out of {len(keep)} real trajectories: {empty} empty, {broken} with values that are no numbers"
    return (data[keep] if bool(keep.any()) else None), note


def united(parts: Iterable[TensorDictBase]) -> TensorDict:
    """Trajectories (n_i, T_i) one behind the other, padded with zeros outside the mask to the longest T.

    They lie where the last of them did.
    """
    parts = [_masked(part) for part in parts]
    longest, device = max(part.shape[1] for part in parts), parts[-1]["mask"].device
    return torch.cat([pad(part.to(device), [0, 0, 0, longest - part.shape[1]]) for part in parts])


def _masked(data: TensorDictBase) -> TensorDictBase:
    """With the mask of whole trajectories, where there is none."""
    if "mask" in data:
        return data
    device = next(iter(data.values(True, True))).device
    return data.set("mask", torch.ones(data.shape, dtype=torch.bool, device=device))
