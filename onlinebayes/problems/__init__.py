"""Problem files: TOML in, built objects out; ``criticise`` runs one, ``load_refined`` reads what ``refine`` wrote.

problem = load_problem("problem.toml")
result = criticise("refine", problem)
"""

from onlinebayes.problems.commands import criticise
from onlinebayes.problems.factory import import_module
from onlinebayes.problems.new_logs import check_logs
from onlinebayes.problems.problem_file import ProblemFile, allowed_in, load_problem
from onlinebayes.problems.refined import Refined, load_refined
from onlinebayes.problems.worlds import RefinedModels, load_worlds, refined_files

__all__ = [
    "ProblemFile",
    "Refined",
    "RefinedModels",
    "allowed_in",
    "check_logs",
    "criticise",
    "import_module",
    "load_problem",
    "load_refined",
    "load_worlds",
    "refined_files",
]
