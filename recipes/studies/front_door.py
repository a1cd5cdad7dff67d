"""``make front-door``: are logs read as people write them?

| row                          | what is asked                                                                  |
|------------------------------|--------------------------------------------------------------------------------|
| conventions matched rightly  | every name of the model that the log has gets its column (:mod:`.conventions`) |
| .. in part                   | some do, and none a wrong one                                                  |
| .. not at all                | none does                                                                      |
| .. wrongly                   | one name or more gets a column that is another thing                           |

    python -m recipes.studies.front_door        -> docs/results/front-door.json
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from onlinebayes.experiments import status
from onlinebayes.runs import ResultTable
from recipes.studies.conventions import CONVENTIONS

FEWEST = 29


@dataclass(frozen=True)
class Study:
    """Options of the study.

    Args:
        results: folder of the table.
    """

    results: Path = Path("docs/results")


def names(table: ResultTable) -> None:
    """Rows of the conventions of names."""
    verdicts = {one.who: one.verdict for one in CONVENTIONS}
    count = Counter(verdicts.values())
    every = f"of {len(CONVENTIONS)}"
    rightly, wrongly = count["rightly"], count["wrongly"]
    table.add("conventions matched rightly", rightly, unit=every, goal=f">= {FEWEST}", holds=rightly >= FEWEST)
    for verdict in ("in part", "not at all"):
        who = [one for one, found in verdicts.items() if found == verdict]
        table.add(f"conventions matched {verdict}", count[verdict], spread="; ".join(who) or None, unit=every)
    who = [one for one, found in verdicts.items() if found == "wrongly"]
    table.add("conventions matched wrongly", wrongly, spread="; ".join(who) or None, goal="0", holds=wrongly == 0)


def main(study: Study) -> int:
    """Print and write the table; returns 1 where a goal is missed."""
    table = ResultTable("front-door", "make front-door", seeds=())
    names(table)
    table.write(study.results)
    print(table.to_markdown())
    return int(not table.holds)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
