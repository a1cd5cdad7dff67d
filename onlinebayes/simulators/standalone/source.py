"""The text of a module that steps a model file with its laws: the sources of the classes, and their numbers."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from pprint import pformat

from onlinebayes.runs import BadInput
from onlinebayes.simulators.standalone import law as laws
from onlinebayes.simulators.standalone.drive import Drive
from onlinebayes.simulators.standalone.law import Law
from onlinebayes.simulators.standalone.model import KINDS, Place, Setup, StandaloneModel

WIDTH = 110

PAGE = '''"""{head}

    model = RefinedModel()
    signals = model.reset(qpos, qvel)
    signals = model.step(ctrl)          # one timestep of {timestep:.6g} s; step(ctrl, steps) for several

It needs mujoco and numpy, and {file} beside it. Commands are in the order of that file's actuators.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path

import mujoco
import numpy as np

{classes}


XML = Path(__file__).with_name("{file}")

SETUP = {setup}


class RefinedModel(StandaloneModel):
    """One world of the refined model; see StandaloneModel for reset, step, model and data."""

    def __init__(self, path: str | Path = XML) -> None:
        super().__init__(path, SETUP)
'''


def module_text(setup: Setup, file: str, head: str) -> str:
    """The module's text.

    Args:
        setup: what stands beside the model file.
        file: its name.
        head: the module's first line.

    Raises:
        BadInput: the source of a law cannot be read.
    """
    kinds = dict.fromkeys(type(law) for _, _, _, law in setup.laws)
    parts = [_source(part) for part in (laws.Servo, laws.Seen, Law, laws.clip, laws.sign, laws.gauss, Drive)]
    parts += [_source(kind) for kind in kinds]
    parts += [
        "Row = Sequence[float] | np.ndarray",
        f"KINDS = {KINDS!r}",
        *(_source(part) for part in (Setup, Place, StandaloneModel)),
    ]
    plain = head.replace("\\", "/").replace('"""', "'''")
    return PAGE.format(
        head="\n".join(textwrap.wrap(plain, WIDTH, break_long_words=False)),
        timestep=setup.timestep,
        file=file,
        classes="\n\n\n".join(parts),
        setup=pformat(setup, width=WIDTH, sort_dicts=False),
    )


def _source(part: type | Callable[..., object]) -> str:
    """The source of a class or a function, from its first decorator on.

    ``inspect.getsource`` leaves decorators out from Python 3.13 on where an import hook added one of its own.
    """
    try:
        lines, line = inspect.findsource(inspect.unwrap(part))
        for node in ast.walk(ast.parse("".join(lines))):
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == part.__name__:
                first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
                if first <= line + 1 <= node.lineno:
                    return textwrap.dedent("".join(lines[first - 1 : node.end_lineno])).rstrip()
        problem = "it is not where it should be"
    except (OSError, TypeError, SyntaxError) as error:
        problem = str(error)
    raise BadInput(f"the source of {part.__name__} cannot be read: {problem}", "define it in a module")
