"""Table 4.1: what one round tells of one parameter, ten rollouts of 50 steps under random actions.

    figure = log q(true value | ten rollouts)      CartPole: the other parameter is unknown, too, and integrated out

With 1 % noise there is a right answer, the ceiling: the exact posterior of the same rollouts; of the pendulum's
timestep, which is no parameter of a simulator here, the posterior of one who knows where each rollout began.
"""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.inference import Belief, BoxUniform, LikelihoodEstimator, Posterior
from onlinebayes.inference.distributions import TruncatedMixture
from onlinebayes.inference.distributions.marginal import Marginal
from onlinebayes.runs import seed_everything
from recipes import pendulum
from recipes.studies.one_round import begun
from recipes.studies.table_systems import SYSTEMS, swung
from recipes.studies.thesis.columns import CEILING, COLUMNS, TEN_AS_ONE, Data, beliefs, ten_as_one

SIMULATIONS, DRAWS, POINTS = 500, 20_000, 600

PROTOCOL = (
    f"one round; {SIMULATIONS} thetas of ten rollouts of 50 steps, random actions; ten measured rollouts;"
    " thesis: 2000 simulations of up to 200 steps, five repeats, the best of its four columns"
)


def judged(name: str, noise: float, seed: int) -> dict[str, Any]:
    """A system's rows: parameter -> column -> log density of the true value."""
    seed_everything(seed)
    system, draw = SYSTEMS[name], begun(seed)
    prior = BoxUniform(system.space)

    def simulate(theta: Tensor, generator: torch.Generator, number: int) -> TensorDict:
        return system.simulate(theta, generator, rollouts=number, noise=noise)

    sets = system.simulate(prior.sample((SIMULATIONS,), draw), draw, noise=noise)
    truth = system.space.vector(system.truth)
    before = torch.Generator().set_state(draw.get_state())
    true = system.simulate(truth[None], draw, noise=noise)[0]
    data = Data(prior, sets, true.exclude("theta"), simulate, system.filtered)
    columns = {**COLUMNS, TEN_AS_ONE: ten_as_one}
    found = {column: marginals(belief, truth) for column, belief in beliefs(data, seed, columns).items()}
    if noise:
        if system.exact is None:
            clean = system.simulate(truth[None], before)[0]
            found[CEILING] = {"dt": timestep_density(clean, true, noise)}
        else:
            found[CEILING] = exact_densities(system.exact(), data, truth, draw)
    return {parameter: {c: values[parameter] for c, values in found.items()} for parameter in system.rows}


def marginals(belief: Belief, truth: Tensor) -> dict[str, float]:
    """Parameter -> log density of its true value, the others integrated out."""
    inner = belief.distribution if isinstance(belief, Posterior) else belief
    assert isinstance(inner, TruncatedMixture)
    names = inner.space.names
    return {name: float(Marginal(inner, [name]).log_prob(truth[i : i + 1])) for i, name in enumerate(names)}


def exact_densities(exact: LikelihoodEstimator, data: Data, truth: Tensor, draw: torch.Generator) -> dict[str, float]:
    """Parameter -> log density of its true value under the exact posterior."""
    exact.fit(data.sets[:, 0], generator=draw)
    posterior, names = exact.condition(data.measured), exact.space.names
    if len(names) == 1:
        return {names[0]: float(posterior.log_prob(truth))}
    draws = posterior.sample((DRAWS,), draw)  # nearly Gaussian, given ten rollouts
    density = torch.distributions.Normal(draws.mean(0), draws.std(0)).log_prob(truth)
    return dict(zip(names, density.tolist(), strict=True))


def timestep_density(clean: TensorDict, true: TensorDict, noise: float) -> float:
    """Log density of the pendulum's true timestep for one who knows the starts, on a grid that is finest at the truth.

    Args:
        clean: the rollouts (n, T) without noise, with their theta.
        true: with it.
        noise: of the sensors, as a share of each range.
    """
    h, bounds = clean["theta"][0, 0].double(), SYSTEMS["Pendulum"].space["dt"]
    away = torch.logspace(-9, 0, POINTS, dtype=torch.float64) * (bounds.high - bounds.low)
    grid = torch.cat([h - away.flip(0), h, h + away])
    grid = grid[(grid >= bounds.low) & (grid <= bounds.high)]
    cos, sin, w = clean["observation"][:, 0].double().unbind(-1)
    size = (len(grid), len(w))
    u = clean["action"][..., 0].double().expand(*size, -1)
    path = swung(grid[:, None].expand(size), torch.atan2(sin, cos).expand(size), w.expand(size), u)
    misfit = (path[:, :, 1:] - true["next", "observation"].double()) / (noise * pendulum.RANGE)
    log_p = -0.5 * misfit.square().sum((1, 2, 3))
    log_p = log_p - log_p.max()
    return float(log_p[grid == h] - torch.trapezoid(log_p.exp(), grid).log())
