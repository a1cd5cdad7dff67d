"""A geom's contacts under properties of their own, whatever touches it: MuJoCo's contact priority.

Two geoms that touch share the larger friction and dimension of the two, and the mean of their ``solref`` and
``solimp`` (MuJoCo: Computation, "Contact parameters"): a floor that rubs more hides how little a foot does. The geom
of higher ``priority`` decides alone. An effect on contacts therefore raises its geom's priority in the worlds in which
it acts, after giving the geom the properties that its contacts have without the effect: those of its pair with the
**leading partner**, the geom that rubs most of those it can touch. With several partners that differ, the effect gives
all contacts what the leading one has, but for its own parameter: ``geom_friction[0]`` or ``geom_solref``. The
coefficients of turning and rolling stay.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Bool

from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.effects import Contact, ContactFriction, ContactSoftness
from onlinebayes.simulators.mujoco.collisions import may_touch
from onlinebayes.simulators.mujoco.native.term import Arrays, NativeTerm

FIELDS = ("geom_priority", "geom_condim", "geom_friction", "geom_solref", "geom_solimp", "geom_solmix")
"""The fields that decide what a contact is like."""


class SlidingFriction(NativeTerm[ContactFriction]):
    """The sliding coefficient."""

    fields = FIELDS

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: ContactFriction, parameters: Arrays) -> None:
        """``geom_friction[0] = mu`` in the worlds where it differs from the model's own."""
        mu = parameters["friction"]
        acts = mu != effect.own
        for i in touching(model, effect.target):
            take_over(model, fields, i, acts)
            fields["geom_friction"][acts, i, 0] = mu[acts]


class Softness(NativeTerm[ContactSoftness]):
    """The time constant and the damping ratio."""

    fields = FIELDS

    def write(self, model: mujoco.MjModel, fields: Arrays, effect: ContactSoftness, parameters: Arrays) -> None:
        """``geom_solref = (T, zeta)`` in the worlds where they differ from the model's own."""
        solref = np.stack([parameters["time_constant"], parameters["damping_ratio"]], axis=1)
        acts = (solref != np.array(effect.own)).any(1)
        for i in touching(model, effect.target):
            take_over(model, fields, i, acts)
            fields["geom_solref"][acts, i] = solref[acts]


def take_over(model: mujoco.MjModel, fields: Arrays, i: int, where: Bool[np.ndarray, " N"]) -> None:
    """Let geom i decide alone in the worlds ``where``, with its leading pair's properties."""
    highest = int(model.geom_priority.max()) + 1
    new = where & (fields["geom_priority"][:, i] != highest)  # not where another effect has done so already
    for name, values in pair_properties(fields, i, leading_partner(model, i)).items():
        fields[name][new, i] = values[new]
    fields["geom_priority"][new, i] = highest


def pair_properties(fields: Arrays, i: int, j: int) -> dict[str, np.ndarray]:
    """Return the contact properties of geoms i and j: name of the field -> (N, ...)."""
    first, second = ({name: fields[name][:, k] for name in FIELDS} for k in (i, j))
    ahead = np.sign(first["geom_priority"] - second["geom_priority"])[:, None]

    def decided(a: np.ndarray, b: np.ndarray, both: np.ndarray) -> np.ndarray:
        return np.where(ahead > 0, a, np.where(ahead < 0, b, both))

    weights = np.maximum(first["geom_solmix"] + second["geom_solmix"], mujoco.mjMINVAL)
    mix = (first["geom_solmix"] / weights)[:, None]
    found = {}
    for name in ("geom_friction", "geom_solref", "geom_solimp"):
        a, b = first[name], second[name]
        found[name] = decided(a, b, mix * a + (1 - mix) * b)
    a, b = first["geom_friction"], second["geom_friction"]
    found["geom_friction"] = decided(a, b, np.maximum(a, b))
    a, b = first["geom_solref"], second["geom_solref"]
    direct = (a[:, :1] <= 0) | (b[:, :1] <= 0)  # stiffness and damping, which do not mix with times
    found["geom_solref"] = decided(a, b, np.where(direct, np.minimum(a, b), found["geom_solref"]))
    a, b = first["geom_condim"][:, None], second["geom_condim"][:, None]
    found["geom_condim"] = decided(a, b, np.maximum(a, b))[:, 0]
    return found


def contacts(model: mujoco.MjModel) -> dict[str, Contact]:
    """Each target of effects on contacts (see :func:`touching`) -> its first geom's, with the leading partner.

    A geom and its body are not both to be tried unasked: the geoms where each has a name, else the body.
    """
    fields = {name: getattr(model, name)[None] for name in FIELDS}
    geoms, bodies = _targets(model)
    nameless = {target for target, members in bodies.items() if any(not model.geom(i).name for i in members)}
    found = {}
    for target, members in {**bodies, **geoms}.items():
        pair = pair_properties(fields, members[0], leading_partner(model, members[0]))
        body = model.body(int(model.geom_bodyid[members[0]])).name
        covered = body in nameless if target in geoms else target not in nameless
        time, ratio = pair["geom_solref"][0].tolist()
        found[target] = Contact(float(pair["geom_friction"][0, 0]), time, ratio, covered)
    return found


def touching(model: mujoco.MjModel, target: str) -> tuple[int, ...]:
    """Ids of the geoms that a target means: the geom of this name, or all that can touch of the body of this name.

    Raises:
        BadInput: no such geom or body moves and can touch anything.
    """
    geoms, bodies = _targets(model)
    known = {**bodies, **geoms}
    if target not in known:
        problem = f"no geom or body '{target}' moves and can touch another, and no <pair> decides for it"
        raise BadInput(problem, nearest(target, known))
    return known[target]


def _targets(model: mujoco.MjModel) -> tuple[dict[str, tuple[int, ...]], dict[str, tuple[int, ...]]]:
    """Geoms by their names, and bodies with all of their geoms; a body that is called like a geom is left out."""
    geoms: dict[str, tuple[int, ...]] = {}
    bodies: dict[str, tuple[int, ...]] = {}
    for i in range(model.ngeom):
        body = int(model.geom_bodyid[i])
        if not model.body_weldid[body] or not partners(model, i):
            continue
        if name := model.geom(i).name:
            geoms[name] = (i,)
        if name := model.body(body).name:
            bodies[name] = (*bodies.get(name, ()), i)
    return geoms, {name: members for name, members in bodies.items() if name not in geoms}


def leading_partner(model: mujoco.MjModel, i: int) -> int:
    """Of the geoms that geom i can touch, the first of those with the most friction in their contact."""
    fields = {name: getattr(model, name)[None] for name in FIELDS}
    return max(partners(model, i), key=lambda j: float(pair_properties(fields, i, j)["geom_friction"][0, 0]))


def partners(model: mujoco.MjModel, i: int) -> list[int]:
    """The geoms that geom i can touch; none where a ``<pair>`` decides its contacts."""
    if i in model.pair_geom1 or i in model.pair_geom2:
        return []
    return np.flatnonzero(may_touch(model)[i]).tolist()
