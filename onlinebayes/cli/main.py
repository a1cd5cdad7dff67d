"""``onlinebayes compare | diagnose | refine | posterior | next problem.toml --out DIR``; first ``init``, last ``show``.

A model and its logs may stand in the place of the problem file (:mod:`.from_model`); ``demo`` needs neither.

Exit status: 0 done, 2 bad input (one line on standard error), 1 a fault of ours (one line where files with the best
answer so far are written, a traceback where there is none), 130 stopped by Ctrl-C, or at work by SIGTERM. What is slow
to import is imported only once the arguments are known to be right.
"""

from __future__ import annotations

import argparse
import errno
import io
import math
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from onlinebayes import __version__
from onlinebayes.cli.files_given import model_and_logs

EXAMPLES = """\
examples:
  onlinebayes init carriage.xml carriage.csv --out carriage.toml
      write a first problem file: columns matched, bounds proposed
  onlinebayes compare carriage.toml --out out/compare
      fit what is free, replay the measurements, show where the model fails
  onlinebayes refine carriage.xml carriage.csv
      both at once: a first problem file is written to out/carriage-refine, and used
  onlinebayes diagnose carriage.toml --out out/diagnose
      the same, then rank the physical effects that the model may lack
  onlinebayes refine carriage.toml --out out/refine
      add the best effect, refit, repeat; writes refined.toml and refined.xml
  onlinebayes posterior out/refine/refined.toml --out out/posterior
      what the log says of each free parameter: a distribution, to train in
  onlinebayes next carriage.toml --out out/next
      propose the recording that decides what is open; writes next.csv
  onlinebayes compare carriage.toml --out out/by-hand --add dry_friction@carriage
      the same with an effect that you add yourself
  onlinebayes check out/refine tonight.csv
      did the machine change since; exit status 1 if it did
  onlinebayes export out/refine --to playground --out out/worlds
      what was found, as worlds to train in: mujoco, playground, mjlab, isaaclab
  onlinebayes show out/refine
      open the report and the recording
  onlinebayes demo
      all of it on a machine of our own, in some minutes

problem files are described in docs/problem-files.md"""

COMMANDS = {
    "compare": "fit what is free, replay, show where it fails",
    "diagnose": "compare, then rank the missing effects",
    "refine": "add the best effect, refit, repeat until the verdict stands",
    "posterior": "say what is known of the free parameters, and what not",
    "next": "propose the recording that decides what is open",
}


EXPORTS = ("json", "mujoco", "playground", "mjlab", "isaaclab")
"""Targets of ``export``."""

BUDGETED = ("compare", "diagnose", "refine", "next")

PATHS = ("problem", "model", "logs", "folder", "out")
"""Arguments that are paths."""

FILES = {
    "bash": "_shtab_compgen_files",
    "zsh": "_files",
    "tcsh": "f",
    "fish": "(__fish_complete_path (commandline -ct))",
    "powershell": "_shtab_powershell_compgen_files",
}
"""Shell -> how its completion, as shtab writes it, proposes files (``shtab.FILE``, without an import of it)."""


class _Parser(argparse.ArgumentParser):
    """Bad arguments are bad input: one line, exit status 2."""

    def error(self, message: str) -> NoReturn:
        """Print one line that also says where help is, and exit with status 2."""
        self.exit(2, f"onlinebayes: error: {' '.join(message.split())}; see {self.prog} --help\n")


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    top = _Parser(
        prog="onlinebayes",
        description="Compare a simulator with measurements, name the physical effect it lacks, add it.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=f"onlinebayes {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, what in COMMANDS.items():
        budget = "[--budget SECONDS] " if name in BUDGETED else ""
        effects = "[--add EFFECT@TARGET [EFFECT@TARGET ...]]"
        usage = f"onlinebayes {name} [-h] --out DIR {budget}{effects} problem | MODEL LOG [LOG ...]"
        command = commands.add_parser(name, help=what, description=what, usage=usage)
        command.add_argument(
            "problem",
            nargs="*",
            help="the problem file (TOML), or a model (.xml, .urdf) and its logs; "
            "for posterior also a folder that refine wrote",
        )
        command.add_argument(
            "--out",
            type=_path,
            metavar="DIR",
            help="where report and recording are written; for a model and its logs out/MODEL-COMMAND by default",
        )
        command.add_argument(
            "--add", nargs="+", action="extend", default=[], metavar="EFFECT@TARGET", help="add an effect by hand"
        )
        if name in BUDGETED:
            command.add_argument(
                "--budget",
                type=_seconds,
                metavar="SECONDS",
                help="processor time, once the model is fitted, after which the best answer so far is given (300)",
            )
    first = commands.add_parser("init", help="write a first problem file", description="write a first problem file")
    first.add_argument("model", help="the model (MJCF)")
    first.add_argument("logs", nargs="+", metavar="LOG", help="measurement tables")
    first.add_argument(
        "--out", type=_path, metavar="FILE", help="where the problem file goes; MODEL.toml here by default"
    )
    first.add_argument("--force", action="store_true", help="write over a file that is there")
    checked = commands.add_parser(
        "check",
        help="say whether new logs still fit what refine found",
        description="say whether new logs still fit what refine found; exit status 0 it holds, 1 the machine changed",
    )
    checked.add_argument("folder", metavar="FOLDER", help="the folder that refine wrote to")
    checked.add_argument("logs", nargs="+", metavar="LOG", help="new logs, in the order of time")
    checked.add_argument(
        "--out", type=_path, metavar="DIR", help="where check.json and check.png go; FOLDER by default"
    )
    taken = commands.add_parser(
        "export",
        help="take what refine found to where you train",
        description="take what refine found to where you train: parameters and effects as worlds to draw from",
    )
    taken.add_argument("folder", metavar="FOLDER", help="the folder that refine wrote to")
    taken.add_argument("--to", required=True, choices=EXPORTS, help="where it goes")
    taken.add_argument("--out", required=True, type=_path, metavar="DIR", help="where the files are written")
    shown = commands.add_parser(
        "demo",
        help="show the whole loop on a machine of our own",
        description="measure, name the missing effect, infer, train: the whole loop on a machine of our own",
    )
    shown.add_argument("--out", type=_path, default="out/demo", metavar="DIR", help="where all goes; out/demo")
    shown.add_argument("--seed", type=int, default=0, help="another machine, other noise, other networks")
    shown.add_argument("--short", action="store_true", help="tiny budgets: shows that the pieces connect")
    show = commands.add_parser("show", help="open the report and the recording", description="open what DIR holds")
    show.add_argument("out", metavar="DIR", help="the folder that a command or a training run wrote")
    show.add_argument("--html", action="store_true", help="open the page only")
    for command in commands.choices.values():
        for argument in command._actions:
            if argument.dest in PATHS:
                argument.complete = FILES  # type: ignore[attr-defined]
    return top


def _path(text: str) -> str:
    """A path that names something: an empty one, as of a variable that is not set, would be the current folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("it is empty: name a path")
    return text


def _seconds(text: str) -> float:
    """A time that can be spent."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is no time: give seconds above 0")
    return seconds


def _is_text(word: str) -> bool:
    try:
        word.encode()
    except UnicodeEncodeError:
        return False
    return True


def _parsed(argv: Sequence[str] | None) -> argparse.Namespace:
    """The arguments; files that stand behind the effects of ``--add`` are none of them."""
    top = parser()
    arguments = top.parse_args(argv)
    if arguments.command not in COMMANDS:
        return arguments
    if not arguments.problem:
        arguments.problem = [item for item in arguments.add if "@" not in item and Path(item).suffix]
        arguments.add = [item for item in arguments.add if item not in arguments.problem]
    wanted = ["problem"] if not arguments.problem else []
    try:
        arguments.problem, arguments.logs = model_and_logs(arguments.problem) if not wanted else ("", [])
    except ValueError as wrong:
        top.error(f"{arguments.command}: {wrong}")
    if arguments.out is None and not arguments.logs:
        wanted.insert(0, "--out")
    if wanted:
        top.error(f"{arguments.command}: the following arguments are required: {', '.join(wanted)}")
    arguments.out = arguments.out or f"out/{Path(arguments.problem).stem}-{arguments.command}"
    return arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status."""
    for word in sys.argv[1:] if argv is None else argv:
        if not _is_text(word):
            print(f"onlinebayes: error: {word!r}: its name is not UTF-8; rename it", file=sys.stderr)
            return 2
    try:
        arguments = _parsed(argv)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 2
    for stream in (sys.stdout, sys.stderr):  # a terminal that lacks a sign shows its code instead
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        return _run(arguments)
    except KeyboardInterrupt:
        print("onlinebayes: stopped by Ctrl-C", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of our output went away (| head)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        from onlinebayes.runs.errors import BadInput

        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            error = BadInput(
                str(error.strerror), "make room, or choose another folder", where=str(error.filename or "disk")
            )
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            error = BadInput("its name is too long for a file", "give a shorter one", where=str(error.filename))
        if isinstance(error, BadInput):
            print(f"onlinebayes: error: {error}", file=sys.stderr)
            return 2
        traceback.print_exc()
        print(f"onlinebayes: a fault of onlinebayes, not of your input: {type(error).__name__}", file=sys.stderr)
        return 3 if arguments.command == "check" else 1  # of a check 1 is an answer


def _run(arguments: argparse.Namespace) -> int:
    if arguments.command == "show":
        from onlinebayes.cli.show import show

        show(arguments.out, html=arguments.html)
        return 0
    if arguments.command == "init":
        from onlinebayes.cli.init import init

        out = arguments.out or f"{Path(arguments.model).stem}.toml"
        return init(arguments.model, arguments.logs, out, arguments.force)
    if arguments.command == "check":
        from onlinebayes.cli.check import check_machine

        return check_machine(arguments.folder, arguments.logs, arguments.out)
    if arguments.command == "export":
        from onlinebayes.cli.export import take_home

        return take_home(arguments.folder, arguments.to, arguments.out)
    if arguments.command == "demo":
        from onlinebayes.cli.demo import demo

        return demo(Path(arguments.out), arguments.seed, arguments.short)
    if arguments.logs:
        from onlinebayes.cli.from_model import drafted

        arguments.problem = drafted(arguments.command, arguments.problem, arguments.logs, arguments.out)
    if arguments.command == "next":
        from onlinebayes.cli.next import propose_next

        return propose_next(arguments.problem, arguments.out, arguments.add, **_budget(arguments))
    if arguments.command == "posterior":
        from onlinebayes.cli.posterior import infer_posterior

        return infer_posterior(arguments.problem, arguments.out, arguments.add)
    from onlinebayes.cli.work import work

    return work(arguments.command, arguments.problem, arguments.out, arguments.add, **_budget(arguments))


def _budget(arguments: argparse.Namespace) -> dict[str, float]:
    """The budget, where one is given."""
    seconds = getattr(arguments, "budget", None)
    return {} if seconds is None else {"budget_s": seconds}


if __name__ == "__main__":
    sys.exit(main())
