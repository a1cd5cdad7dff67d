"""Infrastructure of long work: errors, atomic files, checkpoints, progress, interruption, seeds, TOML."""

from onlinebayes.runs.arrays import read_arrays, write_arrays
from onlinebayes.runs.attempts import Attempts
from onlinebayes.runs.checkpoints import Checkpoint, Checkpoints
from onlinebayes.runs.digest import NoDigest, digest, source_digest
from onlinebayes.runs.errors import BadInput, DiskFull, UnknownName
from onlinebayes.runs.files import atomic_path, check_room, together, write_atomic
from onlinebayes.runs.interrupt import Grace, Interrupt, Stopped, giving_up, heed
from onlinebayes.runs.lock import Lock, NoLocks
from onlinebayes.runs.memo import FolderMemo, Kept, Memo, NoMemo, remembered, users_memo
from onlinebayes.runs.memory import give_back_freed_memory
from onlinebayes.runs.names import nearest, similar
from onlinebayes.runs.plain import plain
from onlinebayes.runs.printable import one_line
from onlinebayes.runs.progress import Progress
from onlinebayes.runs.random_state import OwnRandom, random_state, set_random_state
from onlinebayes.runs.results import ResultTable, Row, versions
from onlinebayes.runs.results_page import result_page
from onlinebayes.runs.revision import commit
from onlinebayes.runs.run_folder import RunFolder
from onlinebayes.runs.seeds import generator, seed_everything, seed_of, worker_seed
from onlinebayes.runs.side_by_side import cores, processor_time, side_by_side
from onlinebayes.runs.stages import Stages
from onlinebayes.runs.stateful import Stateful, gather, load_exactly, restore, restore_part
from onlinebayes.runs.threads import one_torch_thread, torch_threads_kept
from onlinebayes.runs.toml import to_toml
from onlinebayes.runs.watch import UNWATCHED, Watch

__all__ = [
    "UNWATCHED",
    "Attempts",
    "BadInput",
    "Checkpoint",
    "Checkpoints",
    "DiskFull",
    "FolderMemo",
    "Grace",
    "Interrupt",
    "Kept",
    "Lock",
    "Memo",
    "NoDigest",
    "NoLocks",
    "NoMemo",
    "OwnRandom",
    "Progress",
    "ResultTable",
    "Row",
    "RunFolder",
    "Stages",
    "Stateful",
    "Stopped",
    "UnknownName",
    "Watch",
    "atomic_path",
    "check_room",
    "commit",
    "cores",
    "digest",
    "gather",
    "generator",
    "give_back_freed_memory",
    "giving_up",
    "heed",
    "load_exactly",
    "nearest",
    "one_line",
    "one_torch_thread",
    "plain",
    "processor_time",
    "random_state",
    "read_arrays",
    "remembered",
    "restore",
    "restore_part",
    "result_page",
    "seed_everything",
    "seed_of",
    "set_random_state",
    "side_by_side",
    "similar",
    "source_digest",
    "to_toml",
    "together",
    "torch_threads_kept",
    "users_memo",
    "versions",
    "worker_seed",
    "write_arrays",
    "write_atomic",
]
