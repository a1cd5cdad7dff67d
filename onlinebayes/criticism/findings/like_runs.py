"""Runs with like values of a parameter that differs between them: the groups, and globs that name them.

    values in order:  a gap > 5 sd  ->  another group,     sd = the larger one of both neighbours', at least the median

Two or three groups, fewer than runs, are a thing that was changed now and then (a tool, a payload); more are a value
that differs from run to run.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise, takewhile
from statistics import median

from onlinebayes.identification.results import Estimate

GAP = 5.0  # sd
MOST_GROUPS = 3


def like_runs(values: Mapping[str, Estimate]) -> tuple[tuple[str, ...], ...]:
    """The runs by like values, the lowest first; empty where they are no two or three groups.

    Args:
        values: run -> estimate.
    """
    if len(values) < 3:
        return ()
    usual = median(value.sd for value in values.values())
    order = sorted(values, key=lambda run: values[run].mean)
    groups = [[order[0]]]
    for before, run in pairwise(order):
        sd = max(values[before].sd, values[run].sd, usual)
        if values[run].mean - values[before].mean > GAP * sd:
            groups.append([])
        groups[-1].append(run)
    if not 2 <= len(groups) <= min(MOST_GROUPS, len(values) - 1):
        return ()
    as_given = list(values)
    return tuple(tuple(sorted(group, key=as_given.index)) for group in groups)


def globs(groups: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """A glob for each group of several runs, by how their names begin; empty where names do not part the groups."""
    found = []
    for group in groups:
        if len(group) < 2:
            continue
        others = [run for other in groups if other is not group for run in other]
        common = _common_beginning(group)
        beginnings = [re.sub(r"[0-9]+$", "", common), common]
        parting = [b for b in beginnings if b and not any(run.startswith(b) for run in others)]
        if not parting or re.search(r"[*?\[]", "".join(group)):
            return ()
        found.append(f"{parting[0]}*")
    return tuple(found)


def _common_beginning(names: Sequence[str]) -> str:
    return "".join(letters[0] for letters in takewhile(lambda one: len(set(one)) == 1, zip(*names, strict=False)))
