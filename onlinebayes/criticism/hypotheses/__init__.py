"""One search over hypotheses of what is missing in a model, or off in it.

    search = begun(simulator, fit_runs)                 the base model, fitted
    explanation = searched(search, fit_runs)
    explanation.found.hypothesis                        what was added
    explanation.found.fitted                            the mended simulator, and its parameters

``additions`` and ``hypothesis`` say what can be wrong; ``lengths`` and ``discretisation`` choose windows and step;
``rows``, ``fitting`` and ``scoring`` fit and judge; ``screening`` proposes, ``rule`` decides, ``search`` goes on.
"""

from onlinebayes.criticism.hypotheses.explaining import Explanation, begun, searched

__all__ = ["Explanation", "begun", "searched"]
