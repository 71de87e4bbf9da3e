"""Rewrite the tables of a page from run folders.

``python tools/update_results_page.py docs/results.md NAME=FOLDER ...``: a table stands between
``<!-- table: NAME -->`` and ``<!-- end -->``; several folders with one NAME become one table, their methods in the
order given. Run folders are what ``depthprint evaluate`` writes.
"""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path
from typing import Any

from depthprint.errors import DataError, DepthprintError
from depthprint.evaluation.report import REFERENCE, differences_from
from depthprint.io.atomic import atomic_path

LOOP_COLUMNS = {
    "recall_at_100_precision": "R@100P",
    "average_precision": "AP",
    "f1_max": "F1max",
    "extended_precision": "EP",
    "recall_at_1": "recall@1",
}
OBJECT_COLUMNS = {
    "category_accuracy_mean": "category",
    "category_accuracy_std": "over folds",
    "instance_accuracy": "instance",
    "us_per_pair": "us a pair",
}
WITH_INTERVAL = (
    "average_precision",
    "recall_at_100_precision",
    "category_accuracy_mean",
    "instance_accuracy",
)


def table(folders: list[Path]) -> str:
    """Markdown table of the methods of one protocol; DataError where folders do not belong together."""
    reports = [json.loads((folder / "results.json").read_text()) for folder in folders]
    first = reports[0]
    for folder, report in zip(folders, reports, strict=True):
        for field in ("protocol", "data", "counts", "seed"):
            if report[field] != first[field]:
                raise DataError(f"{folder}: expected the {field} of {folders[0]}, got {report[field]!r}")
    methods = {name: figures for report in reports for name, figures in report["methods"].items()}
    columns = OBJECT_COLUMNS if "category_accuracy_mean" in next(iter(methods.values())) else LOOP_COLUMNS
    differences = {name: d for report in reports for name, d in differences_from(report, REFERENCE).items()}
    compared = ("category", "instance") if differences else ()
    titles = [*columns.values(), *(f"{what} - `{REFERENCE}`" for what in compared)]
    lines = ["| method | " + " | ".join(titles) + " |", "|---" * (len(titles) + 1) + "|"]
    for name, figures in methods.items():
        cells = [cell(figures, metric) for metric in columns]
        cells += [difference(differences.get(name, {}).get(what)) for what in compared]
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    counts = ", ".join(f"{value} {name.replace('_', ' ')}" for name, value in first["counts"].items())
    return "\n".join(lines) + f"\n\n{counts}; seed {first['seed']}."


def difference(found: tuple[float, float] | None) -> str:
    """A paired difference with its standard error, or nothing."""
    return "" if found is None else f"{found[0]:+.3f} +- {found[1]:.3f}"


def cell(figures: dict[str, Any], metric: str) -> str:
    """A figure with its interval, or a dash."""
    value = figures.get(metric)
    if value is None or not math.isfinite(value):
        return "-"
    text = f"{value:.1f}" if metric == "us_per_pair" else f"{value:.3f}"
    interval = figures.get("intervals", {}).get(metric)
    if metric in WITH_INTERVAL and interval is not None and None not in interval:
        text += f" [{interval[0]:.2f}, {interval[1]:.2f}]"
    return text


def update(page: Path, folders: dict[str, list[Path]]) -> None:
    """Replace each named table; DataError for a name that the page does not have."""
    text = page.read_text()
    for name, named in folders.items():
        marked = re.compile(rf"(<!-- table: {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
        if not marked.search(text):
            raise DataError(f"{page}: expected a table named {name}, found none")
        content = table(named)
        text = marked.sub(lambda m, c=content: f"{m[1]}{c}\n{m[2]}", text)
    with atomic_path(page) as new:
        new.write_text(text)


def main(arguments: list[str]) -> None:
    """Read PAGE NAME=FOLDER ... and rewrite the page."""
    if len(arguments) < 2 or any("=" not in pair for pair in arguments[1:]):
        raise DataError("expected PAGE NAME=FOLDER ...")
    folders: dict[str, list[Path]] = {}
    for pair in arguments[1:]:
        name, folder = pair.split("=", 1)
        folders.setdefault(name, []).append(Path(folder))
    update(Path(arguments[0]), folders)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (DepthprintError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
