"""``make public-robots``: from a public arm and its log to a policy on the machine, without an edit of the draft.

    init MODEL LOG  ->  refine DRAFT  ->  load_refined(FOLDER)  ->  PPO in its worlds  ->  return on the machine

Both arms have meshes and come with packages that the project needs anyway (:mod:`.robots`); the machine is a copy of
the model with what the table there says. The goals: nothing is left for the user to write in the draft, what is named
is in the machine, and the policy does better on the machine than before training. What the return would be with the
model as it was stands beside it.

    python -m recipes.studies.public_robots [--robots jaco]        -> docs/results/public-robots.json
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from torchrl.envs import EnvBase, TransformedEnv

from onlinebayes.experiments import status
from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import PPOSettings, ppo
from onlinebayes.problems import load_problem, load_refined
from onlinebayes.runs import ResultTable, seed_everything
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.trainers import Policy, collector_of, improve, returns
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.front_door_times import spent
from recipes.studies.jobs import check_names
from recipes.studies.public_robots.posture import Posture
from recipes.studies.public_robots.robots import ROBOTS, PublicRobot, write_log

WORLDS, BATCHES = 32, 40
PERIOD = 0.04
"""Time for which a policy's command is held [s]."""
SETTINGS = PPOSettings(gamma=0.95, learning_rate=3e-3)
LIMIT_S = 900.0
"""Processor time after which a command is stopped [s]."""
OPEN = re.compile(r"^# (MISSING|CHECK|CLOCKS): ", re.MULTILINE)


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    robots: tuple[str, ...] = tuple(ROBOTS)
    """which"""
    budget: float = 300.0
    """processor time of the search [s]"""
    seed: int = 0
    """of the log and of the training"""
    results: Path = Path("docs/results")
    """folder of the table"""


def asked(robot: PublicRobot, study: Study, folder: Path, table: ResultTable) -> None:
    """The rows of one robot."""
    robot.write(folder)
    write_log(robot, robot.write_machine(folder), folder / "log.csv", study.seed)
    model, log, draft, out = (str(folder / name) for name in (robot.model, "log.csv", "draft.toml", "out"))
    begun = spent(["init", model, log, "--out", draft], LIMIT_S)
    questions = len(OPEN.findall(Path(draft).read_text(encoding="utf-8")))
    table.add(f"{robot.name}: lines to write in the draft", questions, goal="0", holds=questions == 0)
    table.add(f"{robot.name}: init, processor time", begun.processor, unit="s")
    refined = spent(["refine", draft, "--out", out, "--budget", f"{study.budget:g}"], LIMIT_S)
    table.add(f"{robot.name}: refine, processor time", refined.processor, unit="s")
    _answer(robot, folder / "out", table)
    _policies(robot, study, folder, table)


def _answer(robot: PublicRobot, out: Path, table: ResultTable) -> None:
    """Rows of what ``refine`` says, and of the error of held-out runs."""
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    named, hidden = ", ".join(report["accepted"]) or "nothing", ", ".join(robot.hidden) or "nothing"
    right = set(report["accepted"]) == {*robot.hidden}
    table.add(f"{robot.name}: named", named, spread=report["verdict"], goal=hidden, holds=right)
    error = report["heldout_error"]
    for when in ("before", "after"):
        times = max(value / error["noise_floor"][name] for name, value in error[when].items())
        table.add(f"{robot.name}: largest held-out error {when}", times, unit="noise floors")


def _policies(robot: PublicRobot, study: Study, folder: Path, table: ResultTable) -> None:
    """Rows of returns on the machine: untrained, trained in the model as it was, and in what ``refine`` found."""
    refined, draft = load_refined(folder / "out"), folder / "draft.toml"
    as_it_was = load_problem(draft).simulator
    truth = folder / "truth.toml"
    text = draft.read_text(encoding="utf-8")
    truth.write_text(text.replace(f'model = "{robot.model}"', 'model = "machine.xml"'), encoding="utf-8")
    machine = _env(load_problem(truth).simulator.with_dt(PERIOD).with_worlds(WORLDS), robot)
    wide = as_it_was.with_dt(PERIOD).with_worlds(WORLDS), BoxUniform(as_it_was.parameters)
    narrow = refined.worlds(WORLDS, PERIOD), refined.belief
    found: dict[str, float] = {}
    for where, (worlds, belief) in (("the draft", wide), ("its report", narrow)):
        seed_everything(study.seed)
        env = TransformedEnv(_env(worlds, robot), ParameterRandomization(belief))
        objective = ppo(env.observation_spec_unbatched, env.action_spec_unbatched, SETTINGS)
        found.setdefault("untrained", _score(machine, objective.policy))
        improve(objective, collector_of(env, objective.policy, steps=Posture.horizon), BATCHES)
        found[f"trained in worlds of {where}"] = _score(machine, objective.policy)
    for name, value in found.items():
        better = value > found["untrained"] if "report" in name else None
        goal = None if better is None else "above untrained"
        table.add(
            f"{robot.name}: return on the machine, {name}", value, unit=f"of {Posture.horizon}", goal=goal, holds=better
        )


def _score(machine: EnvBase, policy: Policy) -> float:
    machine.set_seed(0)
    return float(returns(machine, policy, Posture.horizon).mean())


def _env(simulator: Identifiable, robot: PublicRobot) -> EnvBase:
    return SimulatorEnv(simulator, Posture(robot.home, robot.speeds))


def main(study: Study) -> None:
    """All robots, and the table."""
    check_names(study.robots, ROBOTS)
    table = ResultTable("public-robots", "make public-robots", [study.seed])
    for name in study.robots:
        with tempfile.TemporaryDirectory() as folder:
            asked(ROBOTS[name], study, Path(folder), table)
        print(table.to_markdown(), flush=True)
    print(f"written: {table.write(study.results)}")


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
