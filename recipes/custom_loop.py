"""Our pieces in a TorchRL loop of your own: transforms, an estimator and its posterior, no trainer of ours.

    python -m recipes.custom_loop [--seed S] [--short]      half a minute

TorchRL's collector, buffer, advantage and PPO loss train the policy; ours are the worlds with parameters of their own,
the transform that draws these, the posterior that the same trajectories give, and the journal of the run.
"""

from __future__ import annotations

import sys
from functools import partial

import torch
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement
from torchrl.envs import StepCounter
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.embeddings import SimulatorReference, SummaryEmbedding, TransitionFeatures
from onlinebayes.experiments import Options, closing_line, place_of, status
from onlinebayes.inference import BoxUniform, MixtureEstimator, NeuralPosteriorLoss, Posterior, fit
from onlinebayes.objectives import state_value, stochastic_policy
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import seed_everything
from onlinebayes.trainers import Journal, Point, Problem, SimulatedPlayer, trajectories
from onlinebayes.transforms import ParameterRandomization
from recipes.cartpole import state

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
WORLDS, STEPS = 64, 64  # of a batch


def main(settings: Options) -> int:
    """Train, infer, and look whether both worked."""
    seed_everything(settings.seed)
    prior, truth = BoxUniform(SPACE), torch.tensor([0.5, 0.2], dtype=torch.float64)
    task, place, batches = CartPoleTask(), place_of("custom_loop", settings), 20 if settings.short else 28
    problem = Problem(CartPole(SPACE), task, prior, transforms=lambda: [StepCounter()])  # TorchRL's around ours
    policy, critic = stochastic_policy(*problem.specs, log_prob=True), state_value(problem.specs[0])

    with Journal(place, "custom_loop", prior, SimulatedPlayer(problem, policy, truth), truth) as journal:
        # --- the policy, in worlds of the prior ---------------------------------------------------------------------
        loss = ClipPPOLoss(policy, critic, entropy_coeff=0.01, normalize_advantage=True)
        advantage = GAE(gamma=0.99, lmbda=0.95, value_network=critic, vectorized=False, deactivate_vmap=True)
        buffer = ReplayBuffer(storage=LazyTensorStorage(4096), sampler=SamplerWithoutReplacement(), batch_size=512)
        optimiser = torch.optim.Adam(loss.parameters(), lr=1e-3)
        collector = Collector(
            problem.worlds(WORLDS, ParameterRandomization(prior), settings.seed),
            policy,
            frames_per_batch=WORLDS * STEPS,
            total_frames=batches * WORLDS * STEPS,
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
                    losses = loss(rows).select("loss_objective", "loss_critic", "loss_entropy")
                    sum(losses.values()).backward()
                    torch.nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                    optimiser.step()
                    optimiser.zero_grad()
            if k % 4 == 0:
                told = {name: float(value.detach()) for name, value in losses.items()}
                figures = {
                    "return": problem.score(policy, truth),
                    "longest episode": int(batch["next", "step_count"].max()),
                }
                journal.step("policy", frames=4 * batch.numel(), losses=told, figures=figures)
        collector.shutdown()

        # --- the posterior of one pole, from one trajectory of the same policy --------------------------------------
        simulated = trajectories(problem.worlds(1000, ParameterRandomization(prior), 1), policy, 50)
        reference = SimulatorReference(
            CartPole(SPACE), prior.box.cross(), state=state, command=task.command, observe=task.observe
        )
        embedding = SummaryEmbedding(TransitionFeatures(4, 2, reference=reference, sensitivities=2))
        posterior_loss = NeuralPosteriorLoss(embedding, MixtureEstimator(SPACE, embedding.size))
        train = partial(fit, epochs=20, generator=torch.Generator().manual_seed(settings.seed))
        train(posterior_loss, simulated)
        measured = trajectories(problem.worlds(1, ParameterRandomization(Point(truth)), 2), policy, 50).exclude("theta")
        posterior = Posterior(posterior_loss).condition(measured)
        journal.step("belief", simulated=simulated.numel(), figures=figures, belief=posterior)

    gain = float(posterior.log_prob(truth) - prior.log_prob(truth))
    print(f"the truth gains {gain:.1f} nats over the prior; return {figures['return']:.0f} of {task.horizon}")
    print(closing_line(place))
    return 0 if gain > 0 and figures["return"] > 100 else 1


if __name__ == "__main__":
    sys.exit(status(main, Options, __doc__))
