"""The map of MJCF attributes: address field -> columns of compiled arrays -> attribute of the spec.

An address ``joint.hinge.damping`` names an attribute as MJCF or the spec does; MuJoCo compiles it into one or several
arrays of ``mjModel``. The two tables below are all that addresses, fields per world and export know about it.

| address field            | compiled array                     | note                                              |
|--------------------------|------------------------------------|---------------------------------------------------|
| ``body.x.mass``          | ``body_mass``                      | the inertia stays (as in ``mujoco.sysid``)        |
| ``body.x.inertia[i]``    | ``body_inertia``                   | diagonal in the body's inertial frame             |
| ``body.x.inertial[i]``   | mass, centre, axes, moments        | any value is a body: see :mod:`.pseudo_inertia`   |
| ``joint.x.damping[i]``   | ``dof_damping``, ``dof_dampingpoly`` | -(d0 v + d1 v abs(v) + d2 v^3), all dofs        |
| ``joint.x.stiffness[i]`` | ``jnt_stiffness``, ``..poly``      | -(k0 x + k1 x abs(x) + k2 x^3), x = q - springref |
| ``joint.x.springref``    | ``qpos_spring``                    | [m, rad], whatever angle unit the file uses       |
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """One column of a compiled array: ``array[row]`` for a vector, ``array[row, index]`` for a matrix."""

    array: str
    index: int | None = None


def _columns(array: str, size: int) -> tuple[Column, ...]:
    return tuple(Column(array, i) for i in range(size))


def _polynomial(linear: str, rest: str) -> tuple[Column, ...]:
    return (Column(linear), Column(rest, 0), Column(rest, 1))


# kind -> address field -> its columns; a field of one column takes no index, one marked in PLAIN may leave [0] out.
FIELDS: dict[str, dict[str, tuple[Column, ...]]] = {
    "body": {
        "mass": (Column("body_mass"),),
        "inertia": _columns("body_inertia", 3),
        "ipos": _columns("body_ipos", 3),
        "inertial": _columns("body_inertial", 10),
        "pos": _columns("body_pos", 3),
        "gravcomp": (Column("body_gravcomp"),),
    },
    "joint": {
        "damping": _polynomial("dof_damping", "dof_dampingpoly"),
        "frictionloss": (Column("dof_frictionloss"),),
        "armature": (Column("dof_armature"),),
        "stiffness": _polynomial("jnt_stiffness", "jnt_stiffnesspoly"),
        "springref": (Column("qpos_spring"),),
        "range": _columns("jnt_range", 2),
        "margin": (Column("jnt_margin"),),
        "solref_friction": _columns("dof_solref", 2),
        "solimp_friction": _columns("dof_solimp", 5),
        "solref_limit": _columns("jnt_solref", 2),
        "solimp_limit": _columns("jnt_solimp", 5),
    },
    "geom": {
        "friction": _columns("geom_friction", 3),
        "solref": _columns("geom_solref", 2),
        "solimp": _columns("geom_solimp", 5),
        "margin": (Column("geom_margin"),),
        "gap": (Column("geom_gap"),),
    },
    "pair": {
        "friction": _columns("pair_friction", 5),
        "solref": _columns("pair_solref", 2),
        "solreffriction": _columns("pair_solreffriction", 2),
        "solimp": _columns("pair_solimp", 5),
        "margin": (Column("pair_margin"),),
        "gap": (Column("pair_gap"),),
    },
    "actuator": {
        "gear": _columns("actuator_gear", 6),
        "gainprm": _columns("actuator_gainprm", 10),
        "biasprm": _columns("actuator_biasprm", 10),
        "dynprm": _columns("actuator_dynprm", 10),
        "ctrlrange": _columns("actuator_ctrlrange", 2),
        "forcerange": _columns("actuator_forcerange", 2),
        "armature": (Column("actuator_armature"),),
        "damping": _polynomial("actuator_damping", "actuator_dampingpoly"),
    },
    "tendon": {
        "stiffness": _polynomial("tendon_stiffness", "tendon_stiffnesspoly"),
        "damping": _polynomial("tendon_damping", "tendon_dampingpoly"),
        "frictionloss": (Column("tendon_frictionloss"),),
        "armature": (Column("tendon_armature"),),
        "springlength": _columns("tendon_lengthspring", 2),
        "range": _columns("tendon_range", 2),
        "margin": (Column("tendon_margin"),),
    },
    "sensor": {"cutoff": (Column("sensor_cutoff"),), "noise": (Column("sensor_noise"),)},
    "site": {"pos": _columns("site_pos", 3)},
    "option": {
        "gravity": _columns("opt.gravity", 3),
        "wind": _columns("opt.wind", 3),
        "magnetic": _columns("opt.magnetic", 3),
        "density": (Column("opt.density"),),
        "viscosity": (Column("opt.viscosity"),),
        "impratio": (Column("opt.impratio"),),
    },
}

# Fields whose first column may be written without its index.
PLAIN = frozenset({"damping", "stiffness", "gear"})

# Limits, which bound nothing while the element's flag in the compiled model is off.
LIMITED = {
    ("joint", "range"): "jnt_limited",
    ("tendon", "range"): "tendon_limited",
    ("actuator", "ctrlrange"): "actuator_ctrllimited",
    ("actuator", "forcerange"): "actuator_forcelimited",
}

# Units of an address, {slide, hinge} where they differ; fields that are missing are pure numbers or mixed.
UNITS: dict[tuple[str, str], str | tuple[str, str]] = {
    ("body", "mass"): "kg",
    ("body", "inertia"): "kg m2",
    ("body", "ipos"): "m",
    ("body", "pos"): "m",
    ("joint", "damping"): ("N s/m", "N m s/rad"),
    ("joint", "frictionloss"): ("N", "N m"),
    ("joint", "armature"): ("kg", "kg m2"),
    ("joint", "stiffness"): ("N/m", "N m/rad"),
    ("joint", "springref"): ("m", "rad"),
    ("joint", "range"): ("m", "rad"),
    ("site", "pos"): "m",
    ("option", "gravity"): "m/s2",
    ("option", "wind"): "m/s",
    ("option", "density"): "kg/m3",
    ("option", "viscosity"): "Pa s",
}


@dataclass(frozen=True)
class SpecAttribute:
    """The place of a compiled array in the spec: the element's kind, the attribute, the offset of its first column.

    A negative offset is the number of columns before those that the attribute holds.
    """

    kind: str
    attribute: str
    offset: int = 0


# compiled array -> attribute of the spec's element (see export).
SPEC: dict[str, SpecAttribute] = {
    "body_mass": SpecAttribute("body", "mass"),
    "body_inertia": SpecAttribute("body", "inertia"),
    "body_ipos": SpecAttribute("body", "ipos"),
    "body_iquat": SpecAttribute("body", "iquat"),
    "body_pos": SpecAttribute("body", "pos"),
    "body_gravcomp": SpecAttribute("body", "gravcomp"),
    "dof_damping": SpecAttribute("joint", "damping"),
    "dof_dampingpoly": SpecAttribute("joint", "damping", 1),
    "dof_frictionloss": SpecAttribute("joint", "frictionloss"),
    "dof_armature": SpecAttribute("joint", "armature"),
    "dof_solref": SpecAttribute("joint", "solref_friction"),
    "dof_solimp": SpecAttribute("joint", "solimp_friction"),
    "jnt_stiffness": SpecAttribute("joint", "stiffness"),
    "jnt_stiffnesspoly": SpecAttribute("joint", "stiffness", 1),
    "jnt_range": SpecAttribute("joint", "range"),
    "jnt_margin": SpecAttribute("joint", "margin"),
    "jnt_solref": SpecAttribute("joint", "solref_limit"),
    "jnt_solimp": SpecAttribute("joint", "solimp_limit"),
    "qpos_spring": SpecAttribute("joint", "springref"),
    "geom_friction": SpecAttribute("geom", "friction"),
    "geom_solref": SpecAttribute("geom", "solref"),
    "geom_solimp": SpecAttribute("geom", "solimp"),
    "geom_margin": SpecAttribute("geom", "margin"),
    "geom_gap": SpecAttribute("geom", "gap"),
    "geom_priority": SpecAttribute("geom", "priority"),
    "geom_condim": SpecAttribute("geom", "condim"),
    "geom_solmix": SpecAttribute("geom", "solmix"),
    "geom_pos": SpecAttribute("geom", "pos"),
    "geom_fluid": SpecAttribute("geom", "fluid_coefs", -1),
    "pair_friction": SpecAttribute("pair", "friction"),
    "pair_solref": SpecAttribute("pair", "solref"),
    "pair_solreffriction": SpecAttribute("pair", "solreffriction"),
    "pair_solimp": SpecAttribute("pair", "solimp"),
    "pair_margin": SpecAttribute("pair", "margin"),
    "pair_gap": SpecAttribute("pair", "gap"),
    "actuator_gear": SpecAttribute("actuator", "gear"),
    "actuator_gainprm": SpecAttribute("actuator", "gainprm"),
    "actuator_biasprm": SpecAttribute("actuator", "biasprm"),
    "actuator_dynprm": SpecAttribute("actuator", "dynprm"),
    "actuator_ctrlrange": SpecAttribute("actuator", "ctrlrange"),
    "actuator_forcerange": SpecAttribute("actuator", "forcerange"),
    "actuator_armature": SpecAttribute("actuator", "armature"),
    "actuator_damping": SpecAttribute("actuator", "damping"),
    "actuator_dampingpoly": SpecAttribute("actuator", "damping", 1),
    "tendon_stiffness": SpecAttribute("tendon", "stiffness"),
    "tendon_stiffnesspoly": SpecAttribute("tendon", "stiffness", 1),
    "tendon_damping": SpecAttribute("tendon", "damping"),
    "tendon_dampingpoly": SpecAttribute("tendon", "damping", 1),
    "tendon_frictionloss": SpecAttribute("tendon", "frictionloss"),
    "tendon_armature": SpecAttribute("tendon", "armature"),
    "tendon_lengthspring": SpecAttribute("tendon", "springlength"),
    "tendon_range": SpecAttribute("tendon", "range"),
    "tendon_margin": SpecAttribute("tendon", "margin"),
    "sensor_cutoff": SpecAttribute("sensor", "cutoff"),
    "sensor_noise": SpecAttribute("sensor", "noise"),
    "site_pos": SpecAttribute("site", "pos"),
    "opt.gravity": SpecAttribute("option", "gravity"),
    "opt.wind": SpecAttribute("option", "wind"),
    "opt.magnetic": SpecAttribute("option", "magnetic"),
    "opt.density": SpecAttribute("option", "density"),
    "opt.viscosity": SpecAttribute("option", "viscosity"),
    "opt.impratio": SpecAttribute("option", "impratio"),
}
