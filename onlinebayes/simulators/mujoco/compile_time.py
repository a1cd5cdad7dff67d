"""Attributes that the compiler turns into others, replaced by what they became: written out they would act once more.

| attribute                                                | what stands in its place                     |
|----------------------------------------------------------|----------------------------------------------|
| joint ``springdamper``                                   | ``stiffness``, ``damping``                   |
| compiler ``settotalmass``, ``boundmass``, ``boundinertia`` | every body's inertial                      |
| compiler ``inertiafromgeom="true"``                      | the same                                     |
| actuator ``inheritrange``                                | ``ctrlrange``, of an activation ``actrange`` |
| actuator ``dampratio``                                   | ``biasprm``                                  |
| actuator's computed ``lengthrange``                      | that range                                   |

A model whose mass was fitted would else be scaled back to its old one, a damping follow from another inertia. Source:
https://mujoco.readthedocs.io/en/stable/XMLreference.html.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

TRUE = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
AUTO = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO


def written_out(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Let nothing of the spec depend on what the compiler derives.

    Args:
        spec: changed.
        model: what it compiles to.
    """
    compiler = spec.compiler
    if compiler.settotalmass > 0 or compiler.boundmass or compiler.boundinertia or compiler.inertiafromgeom == TRUE:
        for body in spec.bodies[1:]:
            _write_inertial(body, model)
        compiler.settotalmass, compiler.boundmass, compiler.boundinertia = -1, 0, 0
        compiler.inertiafromgeom = AUTO
    for joint in spec.joints:
        if np.all(np.array(joint.springdamper) > 0):
            joint.springdamper = [0, 0]
            joint.stiffness = [model.jnt_stiffness[joint.id], *joint.stiffness[1:]]
            joint.damping = [model.dof_damping[model.jnt_dofadr[joint.id]], *joint.damping[1:]]
    for actuator in spec.actuators:
        _write_actuator(actuator, model)


def _write_inertial(body: mujoco.MjsBody, model: mujoco.MjModel) -> None:
    if not (mass := float(model.body_mass[body.id])):
        return  # welded to others, whose mass it shares
    body.explicitinertial, body.fullinertia = True, np.full(6, math.nan)
    body.mass, body.inertia = mass, model.body_inertia[body.id].copy()
    body.ipos, body.iquat = model.body_ipos[body.id].copy(), model.body_iquat[body.id].copy()


def _write_actuator(actuator: mujoco.MjsActuator, model: mujoco.MjModel) -> None:
    i = actuator.id
    if actuator.inheritrange > 0:
        actuator.inheritrange = 0
        actuator.ctrlrange, actuator.ctrllimited = (
            model.actuator_ctrlrange[i].copy(),
            int(model.actuator_ctrllimited[i]),
        )
        actuator.actrange, actuator.actlimited = model.actuator_actrange[i].copy(), int(model.actuator_actlimited[i])
    if not np.array_equal(actuator.biasprm, model.actuator_biasprm[i]):
        actuator.biasprm = model.actuator_biasprm[i].copy()
    if model.actuator_lengthrange[i].any():
        actuator.lengthrange = model.actuator_lengthrange[i].copy()
