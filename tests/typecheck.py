"""The run-time type checker of the tests: beartype, with an int accepted where a float is asked for (PEP 484).

``Self`` passes unchecked: functions are decorated one by one, where beartype cannot know the class.
"""

from typing import Any, Self

from beartype import BeartypeConf, FrozenDict, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True, hint_overrides=FrozenDict({Self: Any})))
