"""What a finished run prints, in a terminal and into a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from depthprint.cli.printing import print_run
from depthprint.evaluation.report import results_table
from depthprint.runs.stages import RunSummary

METRICS = ("recall_at_100_precision", "average_precision", "f1_max", "extended_precision", "recall_at_1")
NAME = "scan-context-like-channels+geometry"


@pytest.fixture
def run() -> RunSummary:
    figures = {metric: 0.123 + 0.1 * k for k, metric in enumerate(METRICS)}
    intervals = {metric: [0.1, 0.9] for metric in METRICS}
    report = {
        "protocol": "loops, query-wise and causal", "data": "street", "simulated": True, "truth": "poses", "seed": 0,
        "counts": {"frames": 10}, "methods": {NAME: {**figures, "ms_per_query": 12.0, "intervals": intervals}},
    }  # fmt: skip
    return RunSummary(
        folder=Path("run"), table=results_table(report), figures=(), sentence="Done.", results={}
    )


def test_every_figure_is_whole_in_a_file_and_in_a_narrow_terminal(run, capsys, monkeypatch):
    for columns in (None, "80"):
        monkeypatch.delenv("COLUMNS", raising=False)
        if columns:
            monkeypatch.setenv("COLUMNS", columns)
        print_run(run)
        text = capsys.readouterr().out
        for value in np.arange(len(METRICS)) * 0.1 + 0.123:
            assert f"{value:.3f}" in text
        assert "street (simulated)" in text
        assert "…" not in text
        assert (NAME in text) == (columns is None)  # a narrow terminal folds the name
