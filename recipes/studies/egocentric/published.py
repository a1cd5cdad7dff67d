"""The published policies' recorded rows: their accuracy and use, and Table 3.2, counted anew.

    precision(c) = right where c was said / said c,    recall(c) = right where c was true / true c

DataEgo's signals and single predictions are not at hand, only what its policies did: its rows are theirs, not ours.
"""

from __future__ import annotations

from pathlib import Path

from envs.egocentric import CLASSES, PolicyRun, read_policy_run
from onlinebayes.runs import ResultTable

MULTIMODAL = {
    0.0: "64.02_0.92_0.08_policy_alpha_0",
    0.1: "67.30_0.82_0.18_policy_alpha_01",
    0.2: "77.27_0.4_0.6_policy_alpha_02",
    0.3: "82.45_0.12_0.88_policy_alpha_03",
    0.4: "83.71_0.1_0.9_policy_alpha_04",
}
DATAEGO = {
    0.0: "59.26_1.0_0.0_vuzix_alpha_0",
    0.2: "82.20_0.48_0.52_vuzix_alpha_02",
    0.4: "82.65_0.42_0.58_vuzix_alpha_04",
}
ACTIVITIES = (
    *("walking", "climbing stairs", "chopping food", "riding elevator", "brushing teeth", "riding escalator"),
    *("talking to people", "watching tv", "eating", "cooking on stove", "browsing mobile phone", "washing dishes"),
    *("working on pc", "reading", "writing", "lying down", "running", "doing push ups", "doing sit ups", "cycling"),
)


def runs(folder: Path, names: dict[float, str]) -> dict[float, PolicyRun]:
    """lambda -> the recorded rows."""
    return {trade: read_policy_run(folder / "policy_runs" / f"{name}_rows.csv") for trade, name in names.items()}


def accuracy(run: PolicyRun) -> float:
    """Share of seconds in which the answer is right."""
    return float((run.said == run.label).float().mean())


def use(run: PolicyRun) -> float:
    """Share of seconds with the camera."""
    return float(run.action.float().mean())


def table_3_2(found: dict[float, PolicyRun]) -> ResultTable:
    """Precision and recall of each activity of DataEgo at three lambdas."""
    table = ResultTable("egocentric-table-3.2", "make egocentric", [0])
    for trade, run in found.items():
        table.add(f"accuracy at lambda {trade:g} (use of the camera beside)", accuracy(run), spread=f"{use(run):.2f}")
    for c, name in enumerate(ACTIVITIES[:CLASSES]):
        cells = [f"{p:.2f} / {r:.2f}" for p, r in (_precision_recall(run, c) for run in found.values())]
        table.add(f"{name}: precision / recall at lambda 0, .2, .4", ", ".join(cells))
    return table


def _precision_recall(run: PolicyRun, label: int) -> tuple[float, float]:
    said, true = run.said == label, run.label == label
    right = float((said & true).sum())
    return right / max(float(said.sum()), 1.0), right / max(float(true.sum()), 1.0)
