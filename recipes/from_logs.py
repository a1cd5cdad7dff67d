"""From a machine's log to a policy: find the missing effect, infer its size, train in worlds of what was learnt, save.

    python -m recipes.from_logs [--seed S] [--short]      a few minutes

The machine is a pendulum whose motor answers late, which its model does not know. Its log is made here; with your own
log begin at ``refine``: everything from there on needs the problem file only.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import torch

from envs.driven_pendulum import Protocol
from onlinebayes.cli.problem import load_problem
from onlinebayes.cli.refined import load_refined
from onlinebayes.cli.work import criticise
from onlinebayes.criticism.report import write_report
from onlinebayes.inference import BoxUniform
from onlinebayes.inference.saving import to_state
from onlinebayes.loggers import RunRecorder
from onlinebayes.runs import Checkpoints, seed_everything, write_atomic
from onlinebayes.simulators import Simulator
from recipes.common import settle, status
from recipes.demo.measure import hidden_truth, measure, write_problem
from recipes.demo.policy import Training, episodes, returns, train
from recipes.demo.posterior import Rounds, infer


@dataclass(frozen=True)
class Settings:
    """One run."""

    seed: int = 0
    """another machine, other noise"""
    short: bool = False
    """a small budget: shows that the pieces connect"""
    out: str = "out/from_logs"
    """folder for all files"""


def main(settings: Settings) -> int:
    """The whole arrow; returns the exit status."""
    settle()
    seed_everything(settings.seed)
    out, small = Path(settings.out), settings.short
    protocol = Protocol(fit=7, held=2, seconds=2.0) if small else Protocol(fit=8, held=2, seconds=4.0)
    rounds = Rounds(rounds=1, simulations=150, epochs=8, seconds=1.0) if small else Rounds()
    training = Training(worlds=64, batches=10) if small else Training()

    # A log, and the problem file that names it: the only part that knows the hidden machine.
    log = write_problem(measure(settings.seed, protocol), out)

    # Which effect is missing? refined.toml is the model with it, report.json has the fitted values.
    found = criticise("refine", load_problem(log))
    write_report(found, out / "refine", title="a pendulum's log", problem=log)
    refined = load_refined(out / "refine")
    simulator = refined.problem.simulator
    print(f"missing: {', '.join(found.accepted) or 'nothing'}; fitted: {told(refined.theta, refined.sd, simulator)}")

    # What does the log leave open? The posterior of all parameters, the effect's included.
    fit_runs = [run for run in refined.problem.measurement.runs if run not in (refined.problem.holdout or ())]
    posterior = infer(simulator, refined.problem.measurement.select(fit_runs), rounds, settings.seed, print)
    draws = posterior.sample((2000,))
    print(f"posterior: {told(draws.mean(0), draws.std(0), simulator)}")

    # A policy for all machines that the log allows, and beside it one for all that the model as it was allows.
    mended = train(simulator, posterior, training, settings.seed, print)
    model = load_problem(log).simulator
    wrong = train(model, BoxUniform(model.parameters), training, settings.seed, print)

    truth = hidden_truth(settings.seed)
    scores = {
        name: float(returns(episodes(objective.policy, truth, 20, settings.seed)).mean())
        for name, objective in (("the model as it was", wrong), ("the mended model", mended))
    }
    recorder = RunRecorder(out, "from_logs", simulator.parameters, seconds=2.0, truth=None)
    recorder.belief(1, posterior)
    recorder.returns(1, scores)
    recorder.close()
    saved = Checkpoints(out, "from_logs").save({"policy": mended.policy.state_dict(), "posterior": to_state(posterior)})
    write_atomic(out / "scores.json", json.dumps(scores, indent=1) + "\n")
    for name, score in scores.items():
        print(f"return on the machine, policy trained on {name}: {score:.1f} of 100")
    print(
        f"written: {saved} (policy and posterior), {out / 'refine' / 'report.html'}; onlinebayes show {out / 'refine'}"
    )
    better = scores["the mended model"] > scores["the model as it was"]
    return 0 if found.accepted and (better or small) else 1


def told(values: torch.Tensor, sds: torch.Tensor, simulator: Simulator) -> str:
    """``mass 0.41 ± 0.01 kg, ...``"""
    space = simulator.parameters
    return ", ".join(
        f"{name} {float(value):.3g} ± {float(sd):.1g} {space[name].unit}"
        for name, value, sd in zip(space.names, values, sds, strict=True)
    )


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
