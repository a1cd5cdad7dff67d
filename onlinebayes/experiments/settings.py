"""Settings of one run with a hidden system: the truth, the noise, the kind of run, who steps the worlds."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal, TypeVar

from jaxtyping import Float
from torch import Tensor
from tyro.conf import UseAppendAction

from onlinebayes.experiments.assignments import changed
from onlinebayes.experiments.options import Options
from onlinebayes.runs import BadInput
from onlinebayes.trainers import Point, Schedule, Worlds
from onlinebayes.trainers.distributed import OnRay, Workers
from onlinebayes.transforms import Distribution

D = TypeVar("D")

Kind = Literal["online", "posterior-first", "prior", "oracle"]
"""Algorithm 1; the posterior first, then the policy; a policy in worlds of the prior; one in worlds of the truth."""


@dataclass(frozen=True)
class Settings(Options):
    """Settings of a run with a hidden system.

    Raises:
        BadInput: a negative seed, or noise that is no share below 1.
    """

    seed: int = 0
    """which truth and which random numbers: 0 for the experiment's own values, s for point s + 1 of a Sobol sequence"""
    noise: float = 0.01
    """standard deviation of the sensor noise, as a share of each observed value's range"""
    kind: Kind = "online"
    """online; posterior first, then the policy; a policy in worlds of the prior; an oracle's, in worlds of the truth"""
    ray_workers: int = 0
    """workers on Ray that step the worlds, of this machine or of the cluster at RAY_ADDRESS; 0: this process does;
    not in every experiment"""
    logger: Literal["tensorboard", "wandb"] = "tensorboard"
    """who else is told the curves: TensorBoard, where it is installed, or Weights & Biases"""
    seeds: str = ""
    """a run for each of these, 0..4 or 0,3,7, and a page with their medians and quartiles"""
    truth: Annotated[tuple[str, ...], UseAppendAction] = ()
    """NAME=VALUE [SI], a hidden parameter chosen by hand in the place of the seed's; once for each"""
    set: Annotated[tuple[str, ...], UseAppendAction] = ()
    """NAME=VALUE, a setting of what learns, such as learning_rate=0.001 or widths=64,64; once for each"""

    def __post_init__(self) -> None:
        if self.seed < 0 or not 0 <= self.noise < 1:
            raise BadInput(f"seed {self.seed}, noise {self.noise}", "needs seed >= 0 and 0 <= noise < 1")

    def learning(self, usual: D) -> D:
        """An experiment's usual settings of what learns, with those of the command line in their place.

        Raises:
            BadInput: a name that they lack, or a value that they refuse.
        """
        return changed(usual, self.set)

    def workers(self) -> Workers | None:
        """Return the workers that step the worlds; None for this process."""
        return workers_of(self.ray_workers)

    def schedule(self, steps: int, policy_batches: int, real_steps: int) -> Schedule:
        """The schedule of this kind of run."""
        order = {"online": "online", "posterior-first": "posterior-first"}.get(self.kind, "policy-only")
        return Schedule(steps, policy_batches, real_steps, order=order)  # type: ignore[arg-type]

    def worlds(self, problem: Worlds, truth: Float[Tensor, " P"]) -> Distribution | None:
        """Return the distribution of the policy's worlds; None for the belief."""
        if self.kind == "prior":
            return problem.prior
        return Point(truth) if self.kind == "oracle" else None

    def worlds_in_words(self) -> str:
        """The policy's worlds, where they are not those of the belief; else nothing."""
        return {"prior": "worlds of the prior", "oracle": "worlds of the truth"}.get(self.kind, "")


def workers_of(number: int) -> Workers | None:
    """So many on Ray; None for this process alone. Nothing is started before they are needed."""
    return OnRay(number) if number else None


def recorded_settings(settings: Settings) -> dict[str, Any]:
    """Return the settings that a run's folder remembers, for it goes on with the same only.

    Not where it lies, and no option that was not used: a run is the same in another place, and beside other seeds.
    """
    unused = {name for name in ("ray_workers", "truth", "set") if not getattr(settings, name)}
    return {key: value for key, value in asdict(settings).items() if key not in {"out", "logger", "seeds", *unused}}
