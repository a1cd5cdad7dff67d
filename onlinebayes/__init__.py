"""Sequential policy and posterior optimisation on TorchRL: why does a simulator not match its machine, and what then.

    import onlinebayes

    problem = onlinebayes.load_problem("problem.toml")          # an MJCF model, logs, what is free
    result = onlinebayes.criticise("refine", problem)           # what is missing in the model, as `onlinebayes refine`
    onlinebayes.write_report(result, "out/refine")              # report.html, report.json, run.rrd, refined.toml
    worlds = onlinebayes.worlds_of(result)                      # what the logs leave open, to train a policy in
    policy = onlinebayes.load_policy("out/pendulum-online-0")   # of a training run: policy.act(observation), in numpy

Without files: ``refine(simulator, measurement)``, ``posterior_of_log(simulator, measurement)``,
``next_experiment(result, fit_runs)``. All else is imported from its room: ``from onlinebayes.parameters import
ParameterSpace``; ``docs/architecture.md`` says what each room holds.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from onlinebayes.criticism import compare, next_experiment, refine, worlds_of
    from onlinebayes.policies import load_policy
    from onlinebayes.posterior import posterior_of_log
    from onlinebayes.problems import criticise, load_problem
    from onlinebayes.report import write_report

__version__ = "0.1.0"

__all__ = [
    "compare",
    "criticise",
    "load_policy",
    "load_problem",
    "next_experiment",
    "posterior_of_log",
    "refine",
    "worlds_of",
    "write_report",
]

_ROOMS = {
    "compare": "criticism",
    "criticise": "problems",
    "load_policy": "policies",
    "load_problem": "problems",
    "next_experiment": "criticism",
    "posterior_of_log": "posterior",
    "refine": "criticism",
    "worlds_of": "criticism",
    "write_report": "report",
}


def __getattr__(name: str) -> Any:
    """One of the names above, from its room: importing the package alone loads neither torch nor MuJoCo."""
    if name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"onlinebayes.{_ROOMS[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
