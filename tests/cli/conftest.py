"""The problem in a folder that the tests of problem files have, too."""

from tests.problems.conftest import folder

__all__ = ["folder"]
