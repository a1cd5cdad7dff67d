"""Small models that between them have what the simulator must get right."""

from __future__ import annotations

ARM = """
<mujoco model="arm">
  <option timestep="0.004" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="upper" pos="0 0 1.2">
      <joint name="shoulder" axis="0 1 0" damping="0.4" range="-150 150" armature="0.01"/>
      <geom name="upper" type="capsule" fromto="0 0 0 .5 0 0" size=".03" mass="1.5"/>
      <body name="fore" pos=".5 0 0">
        <joint name="elbow" axis="0 1 0" damping="0.2" stiffness="1.5" springref="20" frictionloss="0.05"/>
        <geom name="fore" type="capsule" fromto="0 0 0 .9 0 0" size=".025" mass="0.8"/>
        <site name="tip" pos=".9 0 0"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="cord" stiffness="0.5" damping="0.05">
      <joint joint="shoulder" coef="1"/>
      <joint joint="elbow" coef="-0.5"/>
    </fixed>
  </tendon>
  <actuator>
    <motor name="lift" joint="shoulder" gear="12" ctrlrange="-1 1"/>
    <position name="bend" joint="elbow" kp="8" kv="0.6" forcerange="-6 6"/>
  </actuator>
  <sensor>
    <jointpos name="reading" joint="elbow" noise="0.01"/>
  </sensor>
</mujoco>
"""
"""Two hinges in degrees, a contact with the floor, a tendon, a motor with limits, a position servo, constraints."""

SLIDE = """
<mujoco model="slide">
  <option timestep="0.002" gravity="0 0 0"/>
  <worldbody>
    <body name="carriage">
      <joint name="rail" type="slide" axis="1 0 0"/>
      <geom size=".1" mass="2"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor" joint="rail"/>
  </actuator>
</mujoco>
"""
"""A mass of 2 kg on a rail and a force: what has a closed form."""

TUMBLER = """
<mujoco model="tumbler">
  <option timestep="0.002" integrator="RK4"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="box" pos="0 0 .5">
      <freejoint name="free"/>
      <geom name="box" type="box" size=".1 .15 .2" mass="1"/>
      <body name="ball" pos="0 0 .3">
        <joint name="ball" type="ball" damping=".01"/>
        <geom type="capsule" fromto="0 0 0 0 0 .3" size=".03" mass=".2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general name="slow" joint="ball" gear="0 1 0" dyntype="filter" dynprm="0.05" gainprm="0.5"/>
  </actuator>
</mujoco>
"""
"""A free joint, a ball joint, contacts, and an actuator with an activation."""

UNSTABLE = """
<mujoco model="unstable">
  <option timestep="0.01" gravity="0 0 0"/>
  <worldbody>
    <body name="mass">
      <joint name="x" type="slide" axis="1 0 0"/>
      <geom size=".1" mass="1"/>
    </body>
  </worldbody>
  <actuator>
    <general name="blow" joint="x" biastype="affine" biasprm="0 0 0"/>
  </actuator>
</mujoco>
"""
"""Diverges within some steps when ``actuator.blow.biasprm[1]`` is large and positive and x is not zero."""
