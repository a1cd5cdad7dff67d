"""From a machine's log to a policy: find the missing effect and its size, train in worlds of what was learnt, save.

    python -m recipes.from_logs [--seed S] [--short]      a few minutes

The machine is a pendulum whose motor answers late, which its model does not know. Its log is made here; with your own
log begin at ``refine``: everything from there on needs the problem file only.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from time import monotonic as clock

from envs.driven_pendulum import Protocol
from onlinebayes.experiments import Options, closing_line, place_of, status
from onlinebayes.identification import Estimate
from onlinebayes.identification.quantities import with_error
from onlinebayes.inference import BoxUniform
from onlinebayes.inference.saving import to_state
from onlinebayes.problems import criticise, load_problem, load_worlds
from onlinebayes.report import write_report
from onlinebayes.runs import Checkpoints, seed_everything
from onlinebayes.trainers import Journal, Policy, PolicyFiles
from recipes.demo.measure import hidden_truth, known, measure, write_problem
from recipes.demo.policy import Training, learner, player, score, train


def main(settings: Options) -> int:
    """The whole arrow; returns the exit status."""
    seed_everything(settings.seed)
    place, small, seed = place_of("from_logs", settings), settings.short, settings.seed
    protocol = Protocol(fit=7, held=2, seconds=2.0) if small else Protocol(fit=8, held=2, seconds=4.0)
    training = Training(worlds=64, batches=10) if small else Training()

    # A log, and the problem file that names it: the only part that knows the hidden machine, but for the judge.
    log, truth = write_problem(measure(seed, protocol), place), hidden_truth(seed)

    def judge(policy: Policy) -> dict[str, float]:
        return {"return": score(policy, truth, 20, seed)}

    # Which effect is missing? refined.toml is the model with it, report.json has the fitted values.
    began = clock()
    found = criticise("refine", load_problem(log))
    write_report(found, place / "refine", title="a pendulum's log", problem=log)
    worlds, refining = load_worlds(place / "refine").worlds, clock() - began
    print(f"missing: {', '.join(found.accepted) or 'nothing'}; fitted: {told(found.parameters)}")

    # A policy for all machines that the model as it was allows: the one to beat.
    model, belief = load_problem(log).simulator, worlds.belief
    wrong, alone = learner(model, BoxUniform(model.parameters), training, seed)
    train(wrong, alone, training, seed, lambda frames, losses: None)
    beside = {"the model as it was": judge(alone.policy)["return"]}

    # A policy for all machines that the log allows: the belief is over the effect's parameters, too.
    mended, objective = learner(worlds.simulator, belief, training, seed)
    shown, policy = player(mended, objective.policy, truth), objective.policy
    files = PolicyFiles(place, "from_logs", objective, mended)
    parts = (place, "from_logs", BoxUniform(belief.space), shown, known(belief.space, truth), beside)
    with Journal(*parts, watchers=(files,)) as journal:
        journal.step("refine", seconds=refining, belief=belief, figures=judge(policy))

        def after(frames: int, losses: dict[str, float]) -> None:
            journal.step("policy", frames=frames, losses=losses, figures=judge(policy))

        train(mended, objective, training, seed, after)
    Checkpoints(place, "from_logs").save({"policy": policy.state_dict(), "belief": to_state(belief)})
    scores = {**beside, "the mended model": judge(policy)["return"]}
    for name, value in scores.items():
        print(f"return on the machine, policy trained on {name}: {value:.1f} of 100")
    print(closing_line(place))
    better = scores["the mended model"] > scores["the model as it was"]
    return 0 if found.accepted and (better or small) else 1


def told(parameters: Mapping[str, Estimate]) -> str:
    """``mass 0.41 ± 0.01 kg, ...``"""
    return ", ".join(f"{name} {with_error(one.mean, one.sd, one.unit)}" for name, one in parameters.items())


if __name__ == "__main__":
    sys.exit(status(main, Options, __doc__))
