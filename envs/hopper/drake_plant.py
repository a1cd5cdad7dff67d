"""Gymnasium's hopper as a Drake system: one diagram, a context for each world, parameters written into the contexts.

| address                   | written with                                     | as in MuJoCo                       |
|---------------------------|--------------------------------------------------|------------------------------------|
| ``pair.*.friction[0]``    | proximity properties of the context's geometries | yes                                |
| ``body.x.mass``           | ``SetSpatialInertiaInBodyFrame``                 | moments about the centre stay      |
| ``joint.x.damping``       | ``SetDamping``                                   | yes                                |
| ``joint.x.armature``      | ``SetRotorInertia``: armature = I n^2            | yes                                |

Motors are generalised forces, ``200 clip(u, -1, 1)``: Drake would cut the actuators' own port off at the command's
range. Contacts are points, of both ends of a capsule as in MuJoCo, by the solver whose law is MuJoCo's: a linear spring
and damper (Castro et al. 2022, An Unconstrained Convex Formulation of Compliant Contact). They are as soft as the file
says (:mod:`envs.hopper.soft_contact`).
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self

import mujoco
import numpy as np

from envs.hopper.soft_contact import SoftContact, soft_contact
from envs.hopper.standard import BODIES, FRICTION, GEAR, JOINTS, STANDARD_MODEL
from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.stepping import DIVERGED

TIMESTEP = 0.002
"""Of the integration [s]."""

GRIP = 2.0
"""Friction where it is no parameter: that of Gymnasium's foot on the floor."""

KNOWN = (
    FRICTION,
    *(f"body.{b}.mass" for b in BODIES),
    *(f"joint.{j}.{f}" for j in JOINTS for f in ("damping", "armature")),
)
"""Addresses that can be parameters here."""

RIGID = SoftContact(stiffness=1e9, relaxation=0.0)
"""Of the floor: the bodies alone are soft."""

Write = Callable[[Any, float], None]
"""(root context, value): set a parameter of one world."""


class DrakePlant:
    """The diagram; it is never changed, so copies of a simulator share it."""

    def __init__(self) -> None:
        self._drake = drake = _import()
        builder = drake.DiagramBuilder()
        self.plant, self.scene = drake.AddMultibodyPlantSceneGraph(builder, TIMESTEP)
        with _quiet():
            drake.Parser(self.plant).AddModels(str(STANDARD_MODEL))
            self._rest_on_ends()
            self.plant.set_contact_model(drake.ContactModel.kPoint)
            self.plant.set_discrete_contact_approximation(drake.DiscreteContactApproximation.kSap)
            self.plant.Finalize()
            self.diagram = builder.Build()
            self.rest = self.diagram.CreateDefaultContext()
            self._set_friction(self.rest, GRIP)
        self._force = self.plant.get_applied_generalized_force_input_port()

    def _rest_on_ends(self) -> None:
        """Two spheres in the place of each capsule, which Drake would let touch the floor in one point at a time."""
        drake, plant, inspector = self._drake, self.plant, self.scene.model_inspector()
        file = mujoco.MjModel.from_xml_path(str(STANDARD_MODEL))
        above = float(file.geom("floor").margin[0])
        for name in BODIES:
            body, soft = plant.GetBodyByName(name), soft_contact(file, f"{name}_geom")
            (geometry,) = plant.GetCollisionGeometriesForBody(body)
            capsule, pose = inspector.GetShape(geometry), inspector.GetPoseInFrame(geometry)
            radius, ends = capsule.radius(), [pose @ np.array([0.0, 0.0, z * capsule.length()]) for z in (-0.5, 0.5)]
            self.scene.RemoveRole(plant.get_source_id(), geometry, drake.Role.kProximity)
            for k, end in enumerate(ends):
                place, ball = drake.RigidTransform(end), drake.Sphere(radius + soft.margin + above)
                plant.RegisterCollisionGeometry(body, place, ball, f"end{k}", self._material(soft))
        (floor,) = plant.GetCollisionGeometriesForBody(plant.world_body())
        self.scene.AssignRole(plant.get_source_id(), floor, self._material(RIGID), drake.RoleAssign.kReplace)

    def _material(self, soft: SoftContact) -> Any:
        """Build the material of a geometry; Drake puts those of two that touch in series."""
        properties = self._drake.ProximityProperties()
        properties.AddProperty("material", "point_contact_stiffness", soft.stiffness)
        properties.AddProperty("material", "relaxation_time", soft.relaxation)
        properties.AddProperty("material", "coulomb_friction", self._drake.CoulombFriction(GRIP, GRIP))
        return properties

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self

    def world(self) -> Any:
        """A fresh context: the model's own parameters, upright and at rest."""
        return self.rest.Clone()

    def writers(self, names: Sequence[str]) -> list[Write]:
        """Return the functions that set the parameters, one for each.

        Raises:
            BadInput: an address that has no meaning here.
        """
        return [self._writer(name) for name in names]

    def read(self, world: Any) -> tuple[np.ndarray, np.ndarray]:
        """qpos and qvel (6,), which are MuJoCo's."""
        context = self.plant.GetMyContextFromRoot(world)
        return self.plant.GetPositions(context), self.plant.GetVelocities(context)

    def place(self, world: Any, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Put a world into a state."""
        context = self.plant.GetMyMutableContextFromRoot(world)
        self.plant.SetPositions(context, qpos)
        self.plant.SetVelocities(context, qvel)

    def advance(self, world: Any, command: np.ndarray, steps: int) -> bool:
        """Timesteps under one held command (3,); False, and the state before them, where the world diverges."""
        before = self.read(world)
        context = self.plant.GetMyMutableContextFromRoot(world)
        self._force.FixValue(context, np.concatenate([np.zeros(3), GEAR * np.clip(command, -1.0, 1.0)]))
        try:
            for _ in range(steps):
                self.diagram.ExecuteForcedEvents(world)
        except RuntimeError:  # the contact solver did not converge, or met a value that is no number
            self.place(world, *before)
            return False
        if not all((np.abs(part) < DIVERGED).all() for part in self.read(world)):
            self.place(world, *before)
            return False
        return True

    def _writer(self, name: str) -> Write:
        if name not in KNOWN:
            raise BadInput(
                f"Drake's hopper has no parameter '{name}'", f"{nearest(name, KNOWN)}; known: {', '.join(KNOWN)}"
            )
        if name == FRICTION:
            return self._set_friction
        element, field = re.fullmatch(r"\w+\.(\w+)\.(\w+)", name).groups()  # type: ignore[union-attr]
        make = {"mass": self._mass_writer, "damping": self._damping_writer, "armature": self._armature_writer}
        return make[field](element)

    def _set_friction(self, world: Any, value: float) -> None:
        drake, context = self._drake, self.scene.GetMyMutableContextFromRoot(world)
        inspector = self.scene.get_query_output_port().Eval(context).inspector()
        for geometry in inspector.GetAllGeometryIds(drake.Role.kProximity):
            properties = drake.ProximityProperties(inspector.GetProximityProperties(geometry))
            properties.UpdateProperty("material", "coulomb_friction", drake.CoulombFriction(value, value))
            source = self.plant.get_source_id()
            self.scene.AssignRole(context, source, geometry, properties, drake.RoleAssign.kReplace)

    def _mass_writer(self, name: str) -> Write:
        """Another mass, the same centre, the same moments about it [kg m2]."""
        body = self.plant.GetBodyByName(name)
        own = body.default_spatial_inertia()
        centre = own.get_com()
        about_centre = own.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()

        def write(world: Any, value: float) -> None:
            moments = about_centre / value
            unit = self._drake.UnitInertia(*np.diag(moments), moments[0, 1], moments[0, 2], moments[1, 2])
            unit = unit.ShiftFromCenterOfMass(-centre) if centre.any() else unit
            body.SetSpatialInertiaInBodyFrame(
                self.plant.GetMyMutableContextFromRoot(world), self._drake.SpatialInertia(value, centre, unit)
            )

        return write

    def _damping_writer(self, name: str) -> Write:
        joint = self.plant.GetJointByName(name)
        return lambda world, value: joint.SetDamping(self.plant.GetMyMutableContextFromRoot(world), value)

    def _armature_writer(self, name: str) -> Write:
        indices = self.plant.GetJointActuatorIndices()
        motor = next(m for m in map(self.plant.get_joint_actuator, indices) if m.joint().name() == name)
        ratio = motor.default_gear_ratio()
        return lambda world, value: motor.SetRotorInertia(
            self.plant.GetMyMutableContextFromRoot(world), value / ratio**2
        )


@contextmanager
def _quiet() -> Iterator[None]:
    """Without Drake's warnings of what it does not read: looks, and MuJoCo's integrator."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)


class _Names:
    """The parts of pydrake that are used."""


def _import() -> Any:
    try:
        import pydrake.geometry as geometry
        import pydrake.math as math
        import pydrake.multibody.parsing as parsing
        import pydrake.multibody.plant as plant
        import pydrake.multibody.tree as tree
        import pydrake.systems.framework as framework
    except ImportError:
        raise BadInput("the engine Drake is not installed", "pip install 'onlinebayes[robotics]'") from None
    drake = _Names()
    for module in (geometry, math, parsing, plant, tree, framework):
        drake.__dict__.update({name: value for name, value in vars(module).items() if not name.startswith("_")})
    return drake
