"""The names that a user needs first: each leads to its room, and the package alone loads nothing heavy."""

from __future__ import annotations

import subprocess
import sys

import pytest

import onlinebayes


def test_every_public_name_is_a_function_of_its_room() -> None:
    for name in onlinebayes.__all__:
        function = getattr(onlinebayes, name)
        assert function.__name__ == name
        assert name in dir(onlinebayes)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'refined'"):
        onlinebayes.refined  # noqa: B018


def test_the_package_alone_loads_neither_torch_nor_mujoco() -> None:
    code = "import sys, onlinebayes; sys.exit(bool({'torch', 'mujoco'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
