"""The abilities of a simulator that identification and criticism need besides stepping it, one in each file.

A function asks for the one that it uses: ``def joint_names(simulator: Measured)``.
"""

from onlinebayes.simulators.abilities.constrained import Constrained
from onlinebayes.simulators.abilities.editable import Editable
from onlinebayes.simulators.abilities.extensible import Extensible
from onlinebayes.simulators.abilities.integrated import Integrated
from onlinebayes.simulators.abilities.measured import Measured
from onlinebayes.simulators.abilities.portable import InFile, Portable
from onlinebayes.simulators.abilities.remembering import Remembering

__all__ = ["Constrained", "Editable", "Extensible", "InFile", "Integrated", "Measured", "Portable", "Remembering"]
