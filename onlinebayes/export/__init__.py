"""A refined machine, taken to where people train: MuJoCo, MuJoCo Playground, mjlab, Isaac Lab, or one JSON file.

export("out/refine", "playground", "out/playground")
"""

from onlinebayes.export.write import TARGETS, export, files_of

__all__ = ["TARGETS", "export", "files_of"]
