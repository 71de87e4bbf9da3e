"""One form of results for every protocol: results.json, its table as CSV, and for the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from depthprint.datasets.base import name_and_kind
from depthprint.errors import DataError
from depthprint.evaluation.loops import LOOP_PROTOCOL, LoopEvaluation, MethodLoops
from depthprint.evaluation.metrics import LoopMetrics
from depthprint.evaluation.objects import ObjectEvaluation
from depthprint.evaluation.pairs import PAIR_PROTOCOL, PairEvaluation
from depthprint.run_folder import versions

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "REFERENCE",
    "accuracy_rows",
    "differences_from",
    "loop_records",
    "loop_report",
    "metric_rows",
    "object_report",
    "object_rows",
    "pair_report",
    "results_table",
]

Report = dict[str, Any]

_LOWER_IS_BETTER = ("ms_per_query", "us_per_pair", "translation_error_m", "rotation_error_deg")
# The row of the objects' table that all others are compared with, view by view.
REFERENCE = "recogniser"

_SHORT = {
    "recall_at_100_precision": "R@100P",
    "average_precision": "AP",
    "f1_max": "F1max",
    "extended_precision": "EP",
    "recall_at_1": "recall@1",
    "ms_per_query": "ms/query",
    "translation_error_m": "pose, m",
    "rotation_error_deg": "pose, deg",
    "category_accuracy_mean": "category",
    "category_accuracy_std": "std",
    "instance_accuracy": "instance",
    "us_per_pair": "us/pair",
}


def loop_report(evaluation: LoopEvaluation, settings: Mapping[str, Any]) -> Report:
    """Content of results.json for the query-wise protocol; times are medians over frames, in milliseconds.

    Where a method measures T_match_query, the median errors of accepted right matches and their number are there too.
    """
    methods = {}
    errors = {method.name: method.pose_errors for method in evaluation.methods}
    measured = any(error.count for error in errors.values())
    for method in evaluation.methods:
        error = errors[method.name]
        poses = {
            "translation_error_m": error.translation_m,
            "rotation_error_deg": error.rotation_deg,
            "poses_measured": error.count,
        }
        methods[method.name] = {
            **_figures(method.metrics),
            "ms_per_query": method.ms_per_query,
            "ms_describe": method.describe_ms,
            "ms_search": method.query_ms,
            **({"delay": method.delay} if method.delay else {}),
            **(poses if measured else {}),
            "intervals": {name: list(interval) for name, interval in method.intervals.items()},
            "detections": {
                "positive": sum(r.outcome == 1 for r in method.records),
                "ignore": sum(r.outcome == 0 and r.match >= 0 for r in method.records),
                "negative": sum(r.outcome == -1 for r in method.records),
            },
        }
    return _report(
        LOOP_PROTOCOL, evaluation, evaluation.truth.counts(), settings, methods, evaluation.truth.rule
    )


def pair_report(evaluation: PairEvaluation, settings: Mapping[str, Any]) -> Report:
    """Content of results.json for the pair-wise protocol."""
    positives = int(evaluation.positive.sum())
    counts = {"positive_pairs": positives, "negative_pairs": len(evaluation.pairs) - positives}
    methods = {m.name: {**_figures(m.metrics), "us_per_pair": m.us_per_pair} for m in evaluation.methods}
    for figures in methods.values():
        # every pair has its own outcome here: best matches, and so recall@1, do not exist
        del figures["recall_at_1"]
    return _report(PAIR_PROTOCOL, evaluation, counts, settings, methods, evaluation.rule)


def object_report(evaluation: ObjectEvaluation, settings: Mapping[str, Any]) -> Report:
    """Content of results.json for the object protocols, with paired differences of every two methods."""
    methods = {
        m.name: {
            "category_accuracy_mean": m.category_accuracy_mean,
            "category_accuracy_std": m.category_accuracy_std,
            "instance_accuracy": m.instance_accuracy,
            "us_per_pair": m.us_per_pair,
            "fold_accuracies": list(m.fold_accuracies),
            "intervals": {name: list(interval) for name, interval in m.intervals.items()},
        }
        for m in evaluation.methods
    }
    counts = {
        "views": len(evaluation.views),
        "objects": len(evaluation.objects),
        "categories": len(evaluation.categories),
        "folds": len(evaluation.methods[0].fold_accuracies),
        "instance_tests": evaluation.n_instance_tests,
    }
    settings = {**settings, "frames": evaluation.frames}
    report = _report(
        evaluation.protocol.words, evaluation, counts, settings, methods, "folder names of the objects"
    )
    for name, differences in (
        ("category_differences", evaluation.category_differences),
        ("instance_differences", evaluation.instance_differences),
    ):
        report[name] = [{**asdict(d), "is_noise": d.is_noise} for d in differences]
    return report


def loop_records(method: MethodLoops) -> tuple[list[str], list[list[Any]]]:
    """Header and rows, one a query: what the method matched it with and what the truth says."""
    names = {1: "positive", 0: "ignore", -1: "negative"}
    rows = [
        [r.query, None, None, None, None, int(r.has_positive)]
        if r.match < 0
        else [r.query, r.match, r.distance, r.shift, names[r.outcome], int(r.has_positive)]
        for r in method.records
    ]
    return ["query", "match", "distance", "shift", "outcome", "has_positive"], rows


def object_rows(evaluation: ObjectEvaluation) -> tuple[list[str], list[list[Any]]]:
    """Header and rows, one a view: its true category and every method's prediction."""
    header = ["category", "instance", "video", "frame", *(m.name for m in evaluation.methods)]
    rows = [
        [v.category, v.instance, v.video, v.frame]
        + [_category(evaluation, int(m.category_predictions[k])) for m in evaluation.methods]
        for k, v in enumerate(evaluation.views)
    ]
    return header, rows


def accuracy_rows(evaluation: ObjectEvaluation) -> tuple[list[str], list[list[Any]]]:
    """Header and rows, one an object: the share of its views that each method puts in its category and its instance.

    What paired differences are made of, so that they can be taken between runs as well.
    """
    methods = evaluation.methods
    header = ["object", *(f"{m.name}_{what}" for m in methods for what in ("category", "instance"))]
    rows = [
        [name]
        + [float(shares[k]) for m in methods for shares in (m.object_accuracies, m.instance_accuracies)]
        for k, name in enumerate(evaluation.objects)
    ]
    return header, rows


def differences_from(report: Report, reference: str) -> dict[str, dict[str, tuple[float, float]]]:
    """Paired differences, each method minus ``reference``, by method: {'category' or 'instance': (mean, error)}."""
    found: dict[str, dict[str, tuple[float, float]]] = {}
    for what in ("category", "instance"):
        for pair in report.get(f"{what}_differences", []):
            if reference not in (pair["first"], pair["second"]):
                continue
            is_first = pair["first"] == reference
            other = pair["second"] if is_first else pair["first"]
            mean = -pair["mean"] if is_first else pair["mean"]
            found.setdefault(other, {})[what] = (mean, pair["standard_error"])
    return found


def _category(evaluation: ObjectEvaluation, number: int) -> str | None:
    return evaluation.categories[number] if number >= 0 else None


def metric_rows(report: Report) -> tuple[list[str], list[list[Any]]]:
    """Header and rows of a report's table for CSV, one method a row: single numbers, then interval ends."""
    methods = _methods(report)
    first = next(iter(methods.values()))
    metrics = [name for name, value in first.items() if isinstance(value, (int, float))]
    bounded = list(first.get("intervals", {}))
    header = ["method", *metrics, *(f"{name}_{end}" for name in bounded for end in ("low", "high"))]
    rows = [
        [name, *(figures[m] for m in metrics), *(end for m in bounded for end in figures["intervals"][m])]
        for name, figures in methods.items()
    ]
    return header, rows


def results_table(report: Report) -> Table:
    """Draw a report for the terminal, the best figure of each column bold; intervals below their figure."""
    from rich import box
    from rich.table import Table

    methods = _methods(report)
    first = next(iter(methods.values()))
    shown = [name for name in _SHORT if name in first]
    data = name_and_kind(report["data"], report["simulated"])
    counts = ", ".join(f"{value} {name.replace('_', ' ')}" for name, value in report["counts"].items())
    table = Table(
        title=f"{data}: {report['protocol']}",
        caption=f"{counts}\ntruth: {report['truth']}; seed {report['seed']}; ranges: bootstrap 95 %",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    table.add_column("method", overflow="fold")
    for metric in shown:
        table.add_column(_SHORT[metric], justify="right", no_wrap=True)
    differences = differences_from(report, REFERENCE)
    for what in ("category", "instance") if differences else ():
        table.add_column(f"{what} - {REFERENCE}", justify="right")
    best = {metric: _best(metric, [figures[metric] for figures in methods.values()]) for metric in shown}
    for name, figures in methods.items():
        intervals = figures.get("intervals", {})
        cells = [_cell(figures[m], intervals.get(m), m, best[m]) for m in shown]
        if differences:
            cells += [_difference(differences.get(name, {}).get(what)) for what in ("category", "instance")]
        table.add_row(name, *cells)
    return table


def _report(
    protocol: str,
    evaluation: LoopEvaluation | PairEvaluation | ObjectEvaluation,
    counts: Mapping[str, int],
    settings: Mapping[str, Any],
    methods: Mapping[str, Mapping[str, Any]],
    truth: str,
) -> Report:
    return {
        "protocol": protocol,
        "data": evaluation.data,
        "simulated": evaluation.simulated,
        "truth": truth,
        "seed": evaluation.seed,
        "counts": dict(counts),
        "settings": dict(settings),
        "versions": versions(),
        "methods": {name: dict(figures) for name, figures in methods.items()},
    }


def _figures(metrics: LoopMetrics) -> dict[str, float]:
    figures = asdict(metrics)
    # scores are negated distances; users set thresholds on distances
    figures["distance_at_100_precision"] = -figures.pop("threshold_at_100_precision")
    return figures


def _methods(report: Report) -> Mapping[str, Mapping[str, Any]]:
    methods: Mapping[str, Mapping[str, Any]] = report.get("methods", {})
    if not methods:
        raise DataError("report: expected at least one method, got none")
    return methods


def _best(metric: str, values: Sequence[float | None]) -> float | None:
    known = [v for v in values if v is not None and math.isfinite(v)]
    if len(known) < 2 or metric == "category_accuracy_std":
        return None
    return min(known) if metric in _LOWER_IS_BETTER else max(known)


def _difference(found: tuple[float, float] | None) -> str:
    return "" if found is None else f"{found[0]:+.3f} +- {found[1]:.3f}"


def _cell(
    value: float | None, interval: Sequence[float | None] | None, metric: str, best: float | None
) -> str:
    if value is None or not math.isfinite(value):
        return "-"
    text = f"{value:.2f}" if metric in _LOWER_IS_BETTER else f"{value:.3f}"
    if best is not None and value == best:
        text = f"[bold]{text}[/bold]"
    if interval is not None and all(end is not None and math.isfinite(end) for end in interval):
        text += f"\n{interval[0]:.2f}-{interval[1]:.2f}"
    return text
