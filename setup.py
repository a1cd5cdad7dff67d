"""The wheel's names: what the repository calls ``envs`` and ``recipes`` is installed inside ``onlinebayes``.

At the top level of an environment these two names could be anybody's, and the later package would overwrite the first.

| in the repository             | in the wheel          |
|-------------------------------|-----------------------|
| ``envs``                      | ``onlinebayes.tasks`` |
| ``recipes``, without studies  | ``onlinebayes.recipes``|

Files are copied line by line, so that a traceback names the line of the repository. An editable install keeps the
repository's names. All else about the package stands in ``pyproject.toml``.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

INSTALLED = {"envs": "onlinebayes.tasks", "recipes": "onlinebayes.recipes"}
"""A folder of the repository -> its name in the wheel."""

NAMED = re.compile(r"(?<![\w.])(envs|recipes)(?=\.[a-z_]| import\b)")
"""A module of theirs, in code or in words; ``torchrl.envs`` is none."""


def renamed(text: str) -> str:
    """Return a file's text with the wheel's names."""
    return NAMED.sub(lambda found: INSTALLED[found[1]], text)


class BuildPy(build_py):
    """Copies packages under the names of the wheel."""

    def run(self) -> None:
        """Copy all packages, and take away what an earlier build left under the old names."""
        if not self.editable_mode:
            self.packages = [renamed(f"{name}.x").removesuffix(".x") for name in self.packages or ()]
            self.package_dir = {**(self.package_dir or {}), **{name: folder for folder, name in INSTALLED.items()}}
            self.package_data = {INSTALLED.get(name, name): data for name, data in self.package_data.items()}
            for folder in INSTALLED:
                shutil.rmtree(Path(self.build_lib) / folder, ignore_errors=True)
        super().run()

    def copy_file(self, infile, outfile, *given, **named):
        """Copy a file; one of the two folders is given the wheel's names."""
        done = super().copy_file(infile, outfile, *given, **named)
        source, target = Path(infile), Path(outfile)
        if source.parts[0] in INSTALLED and source.suffix in (".py", ".toml"):
            target.write_text(renamed(target.read_text(encoding="utf-8")), encoding="utf-8")
        return done


if __name__ == "__main__":
    setup(cmdclass={"build_py": BuildPy})
