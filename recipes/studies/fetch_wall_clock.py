"""``make fetch-wall-clock``: Push without demonstrations, our DDPG with hindsight and stable-baselines3's.

Both have the same networks, minibatch, discount and target rate, one thread of one machine, and no demonstrations.
Ours learns until .9 of 128 goals are reached, as ``make fetch`` does; theirs learns on Gymnasium-Robotics' environment
with one gradient step a step of the environment, its default for off-policy algorithms, for three times as long in
processor time, or until it reaches .9 before.

    python -m recipes.studies.fetch_wall_clock       -> docs/results/fetch-wall-clock.json
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from onlinebayes.experiments import status
from onlinebayes.runs import ResultTable, seed_everything
from onlinebayes.trainers import collector_of
from onlinebayes.transforms import ParameterRandomization
from recipes.fetch import STEPS, WORLDS, objective, success
from recipes.studies.fetch import CASES, made_of
from recipes.studies.fetch_peer import environments
from recipes.studies.resumable import each_kept_or_done

SOLVED, TIMES, EPISODES, MOST, EVERY = 0.9, 3.0, 128, 400, 10


@dataclass(frozen=True)
class Study:
    """What to run."""

    seeds: tuple[int, ...] = (1,)
    """of networks and worlds"""
    out: str = "out/fetch_wall_clock"
    """finished jobs go here"""
    results: Path = Path("docs/results")
    """folder of the table"""


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    table = ResultTable("fetch-wall-clock", "make fetch-wall-clock", study.seeds)

    def job(seed: int) -> dict[str, Any]:
        mine = ours(seed)
        return {"ours": mine, "theirs": theirs(seed, TIMES * mine["seconds"])}

    jobs = {seed: partial(job, seed) for seed in study.seeds}
    found = each_kept_or_done("fetch-wall-clock", study.out, jobs, str)
    table.commit = found.commit
    runs = [(found[seed]["ours"], found[seed]["theirs"]) for seed in study.seeds]
    for key, unit in (("success", "share"), ("frames", "steps"), ("seconds", "s")):
        table.add_seeds(f"ours: {key}", [mine[key] for mine, _ in runs], unit=unit)
        table.add_seeds(f"stable-baselines3: {key}", [other[key] for _, other in runs], unit=unit)
    held = all(mine["success"] >= SOLVED > other["success"] for mine, other in runs)
    table.add("at least three times faster to .9", "yes" if held else "no", goal="yes", holds=held)
    print(table.to_markdown())
    print(f"written: {table.write(study.results)}")
    return 0 if table.holds else 1


def ours(seed: int) -> dict[str, Any]:
    """Learn until .9 is reached, looks at it not counted."""
    seed_everything(seed)
    made, worlds = made_of(CASES["push, alone"])
    learner = objective(made)
    collector = collector_of(made.lean.worlds(WORLDS, ParameterRandomization(worlds), seed), learner.policy, STEPS)
    seconds, share, batch = 0.0, 0.0, 0
    while share < SOLVED and batch < MOST:
        begun = time.process_time()
        for _ in range(EVERY):
            data = collector.next()
            assert data is not None
            learner.update(data)
        seconds, batch = seconds + time.process_time() - begun, batch + EVERY
        share = success(made.exact, learner.policy, worlds, EPISODES).last
    return {"success": share, "frames": batch * WORLDS * STEPS, "seconds": seconds}


def theirs(seed: int, longest: float) -> dict[str, Any]:
    """Learn for so many seconds of processor time, or until .9 is reached."""
    from stable_baselines3 import DDPG, HerReplayBuffer
    from stable_baselines3.common.noise import NormalActionNoise

    with environments() as known:
        env, judge = (gymnasium.wrappers.TimeLimit(known["push"](), STEPS) for _ in range(2))
        model = DDPG(
            "MultiInputPolicy",
            env,
            replay_buffer_class=HerReplayBuffer,
            replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
            policy_kwargs={"net_arch": [64, 64, 64]},
            learning_starts=1000,
            gamma=0.95,
            tau=0.05,
            action_noise=NormalActionNoise(np.zeros(4), 0.2 * np.ones(4)),
            seed=seed,
            device="cpu",
        )
        seconds, share, frames = 0.0, 0.0, 0
        while share < SOLVED and seconds < longest:
            begun = time.process_time()
            model.learn(2000, reset_num_timesteps=False)
            seconds, frames = seconds + time.process_time() - begun, frames + 2000
            if frames % 20_000 == 0 or seconds >= longest:
                share = judged(model, judge)
    return {"success": share, "frames": frames, "seconds": seconds}


def judged(model: Any, env: Any) -> float:
    """Share of episodes whose goal is reached at the last step."""
    reached = 0.0
    for episode in range(EPISODES):
        seen, _ = env.reset(seed=10_000 + episode)
        for _ in range(STEPS):
            seen, _, _, _, told = env.step(model.predict(seen, deterministic=True)[0])
        reached += float(told["is_success"])
    return reached / EPISODES


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
