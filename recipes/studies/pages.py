"""``make pages``: the pages of ``docs/results`` from the tables that there are, and the page of goals.

No study is run: date, commit and figures are those of the tables.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from onlinebayes.experiments import status
from onlinebayes.runs import result_page, write_atomic
from recipes.studies import goals


@dataclass(frozen=True)
class Study:
    """Options of the command."""

    results: Path = Path("docs/results")
    """folder of the tables, and of the pages"""


def main(study: Study) -> None:
    """Write the pages."""
    for file in sorted(study.results.glob("*.json")):
        table = json.loads(file.read_text(encoding="utf-8"))
        write_atomic(file.with_suffix(".md"), result_page(table))
    goals.main(goals.Study(study.results))


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
