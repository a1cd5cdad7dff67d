"""One search over hypotheses of what is missing in a model, or off in it.

    explanation = explain(simulator, measurement)
    explanation.found.hypothesis        what was added
    explanation.found.fitted            the mended simulator, and its parameters

``additions`` and ``hypothesis`` say what can be wrong; ``lengths`` and ``discretisation`` choose windows and step;
``rows``, ``fitting`` and ``scoring`` fit and judge; ``screening`` proposes, ``rule`` decides, ``search`` goes on.
"""

from onlinebayes.criticism.hypotheses.explaining import Explanation, explain

__all__ = ["Explanation", "explain"]
