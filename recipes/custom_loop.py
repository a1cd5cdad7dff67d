"""Our pieces in a TorchRL loop of your own: transforms, an estimator and its posterior, no trainer of ours.

    python -m recipes.custom_loop      half a minute

TorchRL's collector, buffer, advantage and PPO loss train the policy; ours are the worlds with parameters of their own,
the transform that draws these, and the posterior that the same trajectories give.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial

import torch
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement
from torchrl.envs import StepCounter, TransformedEnv
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.embeddings import SimulatorReference, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import BoxUniform, MixtureEstimator, NeuralPosteriorLoss, Posterior, fit
from onlinebayes.loggers import RunRecorder
from onlinebayes.objectives import state_value, stochastic_policy
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import seed_everything
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.trainers import Point, trajectories
from onlinebayes.transforms import ParameterRandomization
from recipes.cartpole import state
from recipes.common import settle, status

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})


@dataclass(frozen=True)
class Settings:
    """One run."""

    seed: int = 0
    """of networks, worlds and draws"""
    batches: int = 24
    """of 64 worlds x 64 steps"""
    out: str = "out/custom_loop"
    """the recording goes here"""


def worlds(number: int, drawn: ParameterRandomization, seed: int) -> TransformedEnv:
    """CartPole worlds, each with a pole of its own; TorchRL's transforms stand around ours."""
    env = TransformedEnv(SimulatorEnv(CartPole(SPACE, number), CartPoleTask(), seed=seed), drawn)
    env.append_transform(StepCounter())
    return env


def main(settings: Settings) -> int:
    """Train, infer, and look whether both worked."""
    settle()
    seed_everything(settings.seed)
    prior, truth = BoxUniform(SPACE), torch.tensor([0.5, 0.2], dtype=torch.float64)

    # --- the policy, in worlds of the prior -------------------------------------------------------------------------
    env = worlds(64, ParameterRandomization(prior), settings.seed)
    observed, acting = env.observation_spec_unbatched, env.action_spec_unbatched
    policy, critic = stochastic_policy(observed, acting, log_prob=True), state_value(observed)
    loss = ClipPPOLoss(policy, critic, entropy_coeff=0.01, normalize_advantage=True)
    advantage = GAE(gamma=0.99, lmbda=0.95, value_network=critic, vectorized=False, deactivate_vmap=True)
    buffer = ReplayBuffer(storage=LazyTensorStorage(4096), sampler=SamplerWithoutReplacement(), batch_size=512)
    optimiser = torch.optim.Adam(loss.parameters(), lr=1e-3)
    frames, recorder = 64 * 64, RunRecorder(settings.out, "custom_loop", SPACE, seconds=10.0, truth=truth)
    collector = Collector(
        env,
        policy,
        frames_per_batch=frames,
        total_frames=settings.batches * frames,
        auto_register_policy_transforms=False,
    )
    for k, batch in enumerate(collector, 1):
        batch["next", "reward"] *= 0.01  # values of order one
        with torch.no_grad():
            advantage(batch)
        buffer.empty()
        buffer.extend(batch.reshape(-1).exclude("collector", "step_count"))
        for _ in range(4):
            for rows in buffer:
                losses = loss(rows)
                (losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]).backward()
                torch.nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimiser.step()
                optimiser.zero_grad()
        longest = int(batch["next", "step_count"].max())
        recorder.step(k, {"figures/longest episode": longest, "losses/critic": float(losses["loss_critic"].detach())})
        print(f"batch {k}: {k * frames} frames, longest episode {longest} steps", flush=True)
    collector.shutdown()

    # --- the posterior of one pole, from one trajectory of the same policy ------------------------------------------
    simulated = trajectories(worlds(1000, ParameterRandomization(prior), 1), policy, 50)
    task = CartPoleTask()
    reference = SimulatorReference(
        CartPole(SPACE), BoxUniform(SPACE).box.cross(), state=state, command=task.command, observe=task.observe
    )
    embedding = SummaryEmbedding(TransitionFeatures(4, 2, reference=reference, sensitivities=2))
    posterior_loss = NeuralPosteriorLoss(embedding, MixtureEstimator(SPACE, embedding.size))
    train = partial(fit, epochs=20, generator=torch.Generator().manual_seed(settings.seed))
    train(posterior_loss, simulated)
    measured = trajectories(worlds(1, ParameterRandomization(Point(truth)), 2), policy, 50).exclude("theta")
    posterior = Posterior(posterior_loss).condition(measured)
    recorder.belief(settings.batches, posterior)
    recorder.close()
    gain = float(posterior.log_prob(truth) - prior.log_prob(truth))
    mean = ", ".join(f"{name} {value:.2f}" for name, value in zip(SPACE.names, posterior.mean().tolist(), strict=True))
    print(f"posterior mean: {mean} (truth: 0.50, 0.20); the truth gains {gain:.1f} nats over the prior")
    print(f"written: {recorder.path}   open it with: rerun {recorder.path}")
    return 0 if gain > 0 and longest > 100 else 1


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
