"""Sequential policy and posterior optimisation on TorchRL.

Rooms, from the top: ``cli``, ``trainers``, ``criticism``, then ``inference``, ``objectives`` and ``loggers``, then
``transforms``, ``embeddings`` and ``measurements``, ``simulators``, ``parameters``, ``runs``. Upper rooms import lower
ones. Import a name from the room it lives in: ``from onlinebayes.parameters import ParameterSpace``.
"""

__version__ = "0.1.0"
