"""What every long piece of work needs: errors, atomic files, progress, interruption, seeds, result tables, TOML."""

from onlinebayes.runs.errors import BadInput
from onlinebayes.runs.files import atomic_path, write_atomic
from onlinebayes.runs.interrupt import Interrupt, Stopped, heed
from onlinebayes.runs.names import nearest, similar
from onlinebayes.runs.printable import one_line
from onlinebayes.runs.progress import Progress
from onlinebayes.runs.results import ResultTable, Row
from onlinebayes.runs.seeds import generator, seed_everything
from onlinebayes.runs.threads import one_torch_thread
from onlinebayes.runs.toml import to_toml
from onlinebayes.runs.watch import UNWATCHED, Watch

__all__ = [
    "UNWATCHED",
    "BadInput",
    "Interrupt",
    "Progress",
    "ResultTable",
    "Row",
    "Stopped",
    "Watch",
    "atomic_path",
    "generator",
    "heed",
    "nearest",
    "one_line",
    "one_torch_thread",
    "seed_everything",
    "similar",
    "to_toml",
    "write_atomic",
]
