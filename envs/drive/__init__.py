"""The electro-mechanical positioning system (EMPS): a motor, a ball screw and a carriage on a rail.

    m x'' = gear u - d x'          x the carriage's position [m], u the controller's output [V]

The model is rigid with viscous friction only; the real drive has dry friction and a constant load besides, which is
what makes it a test of criticism. Benchmark: Janot, Gautier and Brunot, "Data Set and Reference Models of EMPS",
Workshop on Nonlinear System Identification Benchmarks, 2019.
"""

from __future__ import annotations

from pathlib import Path

from onlinebayes.parameters import Parameter, ParameterSpace

MODEL = Path(__file__).with_name("drive.xml")
"""MJCF with the slide joint and the body ``carriage`` and the motor ``motor``."""

FREE = ParameterSpace(
    {
        "body.carriage.mass": Parameter(50.0, 150.0, "kg"),
        "joint.carriage.damping": Parameter(0.0, 1000.0, "N s/m"),
    }
)
"""Mass and damping, within what a data sheet would promise."""

__all__ = ["FREE", "MODEL"]
