"""``model = "package.module:factory"``: runs a function of the user's own; what it gives becomes a simulator or a spec.

| the factory returns                                                  | becomes                            |
|----------------------------------------------------------------------|------------------------------------|
| an onlinebayes ``Simulator``                                         | itself                             |
| a ``mujoco.MjSpec``                                                  | that spec                          |
| a ``dm_control.mjcf`` model, a Composer entity, task or environment  | the spec of its XML and its assets |
| a ``dm_control`` ``Physics``, or an environment that has one         | the spec of its XML, see below     |

A compiled ``Physics`` does not hold its XML. MuJoCo remembers the last one that it loaded; it is taken when it compiles
to the same model, number for number, and refused else: effects that change the structure cannot be added to a compiled
model. The files of its meshes are not remembered: their shapes are the compiled model's. Nothing here imports
dm_control: its objects are known by what they have.

Naming a factory runs code. It is looked for among installed packages and in the folder in which the command runs, not
beside the problem file, so that a file from elsewhere cannot bring its own.
"""

from __future__ import annotations

import importlib
import inspect
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np

from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.mujoco.assets import take_shapes
from onlinebayes.simulators.mujoco.model import compile_spec, quiet

RETURNS = "return a Identifiable, an MjSpec, or a dm_control model, entity, environment or Physics"


def from_factory(model: str, parameters: ParameterSpace) -> Identifiable | mujoco.MjSpec:
    """Call a factory and return its simulator or model.

    Args:
        model: ``"package.module:factory"``; called with ``parameters``, or without where it takes no argument.
        parameters: of the problem file.

    Raises:
        BadInput: no such factory, one that raises, or a result of another kind.
    """
    module, _, name = model.rpartition(":")
    found = import_module(module)
    try:
        if not callable(make := getattr(found, name, None)):
            raise BadInput(f"module '{module}' has no factory '{name}'", f"name a function; it may {RETURNS}")
        made = make(parameters) if _takes_parameters(make) else make()
        return made if isinstance(made, Identifiable) else _spec(made, model)
    except BadInput:
        raise
    except (Exception, SystemExit) as error:  # the user's own code: whatever it raises is theirs to mend
        raise BadInput(f"'{model}' raised {type(error).__name__}: {error}", "mend the factory") from error


def import_module(name: str) -> ModuleType:
    """An installed module, or one in the current folder; raises :class:`BadInput` when it cannot be imported."""
    with _current_folder():
        try:
            return importlib.import_module(name)
        except (Exception, SystemExit) as error:  # a script that ends with sys.exit does not choose our exit status
            problem = f"module '{name}' cannot be imported: {type(error).__name__}: {error}"
            raise BadInput(problem, "install it, or run the command in the folder that holds it") from error


def _takes_parameters(make: Any) -> bool:
    """Check whether the factory wants an argument; optional ones (dm_control's own) are left alone."""
    wanted = inspect.signature(make).parameters.values()
    plain = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return any(p.kind in plain and p.default is p.empty for p in wanted)


def _spec(made: Any, model: str) -> mujoco.MjSpec:
    if isinstance(made, mujoco.MjSpec):
        return made
    made = getattr(getattr(made, "task", made), "root_entity", made)
    made = getattr(made, "mjcf_model", made)
    if hasattr(made, "to_xml_string") and hasattr(made, "get_assets"):
        root = getattr(made, "root_model", made)
        return mujoco.MjSpec.from_string(root.to_xml_string(), assets=root.get_assets())
    physics = getattr(made, "physics", made)
    compiled = getattr(getattr(physics, "model", None), "ptr", getattr(physics, "model", physics))
    if isinstance(compiled, mujoco.MjModel):
        return _last_loaded(compiled, model)
    raise BadInput(f"'{model}' returned a {type(made).__name__}", RETURNS)


def _last_loaded(compiled: mujoco.MjModel, model: str) -> mujoco.MjSpec:
    """The spec of the XML that MuJoCo loaded last, if it is this model's."""
    refused = BadInput(
        f"'{model}' returned a compiled model whose XML is not known",
        "return an MjSpec or the dm_control mjcf model: effects change the model's structure before it is compiled",
    )
    with tempfile.TemporaryDirectory() as folder, quiet():
        path = Path(folder) / "model.xml"
        try:
            mujoco.mj_saveLastXML(str(path), compiled)
            spec = mujoco.MjSpec.from_file(str(path))
            take_shapes(spec, compiled)
            again = compile_spec(spec.copy())
        except (ValueError, RuntimeError, mujoco.FatalError, BadInput):
            raise refused from None
    if not _same(again, compiled):
        raise refused
    return spec


def _same(a: mujoco.MjModel, b: mujoco.MjModel) -> bool:
    """Check whether two models have the same structure and numbers, as far as XML with six digits can hold them."""
    if (a.nq, a.nv, a.nu, a.nbody, a.ngeom, a.names) != (b.nq, b.nv, b.nu, b.nbody, b.ngeom, b.names):
        return False
    fields = ("body_mass", "body_inertia", "body_pos", "jnt_axis", "dof_damping", "dof_armature", "geom_size")
    gears = ("actuator_gear", "actuator_gainprm", "actuator_biasprm", "jnt_stiffness", "dof_frictionloss")
    return all(np.allclose(getattr(a, f), getattr(b, f), rtol=1e-4, atol=1e-8) for f in (*fields, *gears))


@contextmanager
def _current_folder() -> Iterator[None]:
    folder = str(Path.cwd())
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
