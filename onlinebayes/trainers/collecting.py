"""Batches of a policy in randomised worlds, by TorchRL's collector."""

from __future__ import annotations

from torchrl.collectors import Collector
from torchrl.envs import EnvBase

from onlinebayes.runs import Stopped, heed
from onlinebayes.trainers.improve import Batches
from onlinebayes.trainers.trajectories import Policy


def collector_of(env: EnvBase, policy: Policy, steps: int) -> Batches:
    """Batches (N, ``steps``) of a policy in an environment of N worlds, without end."""
    return Collector(
        env,
        policy,
        frames_per_batch=env.batch_size.numel() * steps,
        total_frames=-1,
        trust_policy=True,
        track_traj_ids=False,
        auto_register_policy_transforms=False,
        interruptor=_Heeding(),
    )


class _Heeding:
    """Asked by a collector after each of its steps; an error there would shut it down."""

    def collection_stopped(self) -> bool:
        """True where the block in hand is to end: the batch is cut short there, for nobody."""
        try:
            heed()
        except Stopped:
            return True
        return False
