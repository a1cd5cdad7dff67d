"""A model file with laws that MuJoCo has no term for, as one Python module without this library.

module_text(setup, "refined.xml")  ->  the text of refined_model.py: RefinedModel, with reset() and step()
"""

from onlinebayes.simulators.standalone.law import Law
from onlinebayes.simulators.standalone.model import Setup, StandaloneModel
from onlinebayes.simulators.standalone.source import module_text

__all__ = ["Law", "Setup", "StandaloneModel", "module_text"]
