"""One search over hypotheses of what is missing in a model, or off in it.

    search = start_search(simulator, fit_runs)                              the base model, fitted
    search = run_search(search, fit_runs, "all", most=6)
    explanation_of(search).found.hypothesis                                 what was added

``additions`` says what can be added, ``screening`` predicts what each would gain, ``search`` adds what the rule of
``identification/judging`` prefers, ``explanation`` is the path from a model and its runs to an answer.
"""

from onlinebayes.criticism.hypotheses.explanation import Explanation, explanation_of, run_search, start_search

__all__ = ["Explanation", "explanation_of", "run_search", "start_search"]
