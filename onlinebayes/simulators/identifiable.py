"""The interface that identification and criticism need besides stepping: every ability of :mod:`.abilities`.

| ability                               | class                                              |
|---------------------------------------|----------------------------------------------------|
| what it measures, and is commanded by | ``Measured``: the only one without defaults        |
| what effects can act on               | ``Extensible``, which is ``Measured``              |
| how it integrates                     | ``Integrated``: by default in one way              |
| what motion and commands leave behind | ``Remembering``: by default nothing that is known  |
| constraints between joints            | ``Constrained``: by default none                   |
| the same system, a little different   | ``Editable``: by default no variants               |
| a file of its engine                  | ``Portable``: by default there is none             |
"""

from __future__ import annotations

from onlinebayes.simulators.abilities import Constrained, Editable, Extensible, Integrated, Portable, Remembering


class Identifiable(Extensible, Integrated, Remembering, Constrained, Editable, Portable):
    """A simulator that a log can be replayed through, and whose parameters a log can tell."""
