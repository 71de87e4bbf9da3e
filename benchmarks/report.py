"""What a run leaves behind: results.json, and its table between the markers of BENCHMARKS.md."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any

from benchmarks.harness import version
from depthprint import __version__
from depthprint.io.atomic import atomic_path

__all__ = ["machine", "table", "write_page", "write_results"]

BEGIN, END = "<!-- table: made by make bench -->", "<!-- end of table -->"


def machine() -> dict[str, Any]:
    """Processor, cores and versions that a reader needs to judge the figures."""
    return {
        "date": date.today().isoformat(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
        "depthprint": __version__,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def write_results(path: Path, rows: Mapping[str, Mapping[str, Any]], quick: bool) -> dict[str, Any]:
    """Write rows by name, keeping those of an earlier run of the same kind that this one did not measure."""
    kept: dict[str, Any] = {}
    if path.exists():
        earlier = json.loads(path.read_text())
        if earlier.get("quick") == quick:
            kept = {name: row for name, row in earlier.items() if isinstance(row, dict) and "ours_s" in row}
    results = {
        "machine": machine(),
        "quick": quick,
        **kept,
        **{name: dict(row) for name, row in rows.items()},
    }
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(results, indent=1) + "\n")
    return results


def table(results: Mapping[str, Any]) -> str:
    """The rows as Markdown: one line a comparison, then the points of the growth."""
    facts = results["machine"]
    lines = [
        f"{facts['date']}, {facts['processor']}, {facts['cores']} cores, Python {facts['python']}, "
        f"NumPy {facts['numpy']}, numba {facts['numba']}, depthprint {facts['depthprint']}"
        + ("; **quick sizes, not the figures to quote**" if results["quick"] else ""),
        "",
        "| comparison | size | threads | ours | peer | peer's time | ratio | remarks |",
        "|---|---|---|---|---|---|---|---|",
    ]
    rows = {name: row for name, row in results.items() if isinstance(row, dict) and "ours_s" in row}
    for name, row in rows.items():
        cells = (
            name, row["size"], row["threads"], _seconds(row["ours_s"]) + f" a {row['unit']}",
            f"{row['peer']} {row['peer_version']}".strip() or "-", _seconds(row["peer_s"]),
            "-" if row["ratio"] is None else f"{row['ratio']:.1f}", _remarks(row),
        )  # fmt: skip
        lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    if "scaling" in rows:
        lines += ["", "| places | median query | slowest | EMDs solved | memory |", "|---|---|---|---|---|"]
        lines += [
            f"| {point['places']} | {_seconds(point['query_s'])} | {_seconds(point['slowest_query_s'])} "
            f"| {point['share_of_emds_solved']:.3%} | {point['memory_mb']:.0f} MB |"
            for point in rows["scaling"]["points"]
        ]
    return "\n".join(lines)


def write_page(path: Path, results: Mapping[str, Any]) -> None:
    """Put the table between the markers of the page; the text about it stays."""
    text = path.read_text()
    head, found, rest = text.partition(BEGIN)
    _, ended, tail = rest.partition(END)
    if not found or not ended:
        raise ValueError(f"{path}: expected the lines {BEGIN!r} and {END!r}")
    with atomic_path(path) as temporary:
        temporary.write_text(f"{head}{BEGIN}\n\n{table(results)}\n\n{END}{tail}")


def _seconds(value: float | None) -> str:
    if value is None:
        return "-"
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-6:.3g} us"


def _remarks(row: Mapping[str, Any]) -> str:
    remarks = [row["note"]] if row["note"] else []
    if "largest_relative_difference" in row:
        remarks.append(f"values within {row['largest_relative_difference']:.0e}")
    if "share_of_emds_solved" in row:
        remarks.append(f"{row['share_of_emds_solved']:.2%} of EMDs solved")
    if "share_of_same_supports" in row:
        remarks.append(f"same supports in {row['share_of_same_supports']:.2%}")
    if "held_out_objective_ours" in row:
        ours, peer = row["held_out_objective_ours"], row["held_out_objective_peer"]
        remarks.append(f"held-out objective {ours:.5f}, theirs {peer:.5f}")
    if "exponent" in row:
        remarks.append(f"exponent {row['exponent']:.2f}")
    if "stages_ms" in row:
        stages = ", ".join(f"{name} {median:.1f}" for name, (median, _) in row["stages_ms"].items())
        remarks.append(
            f"99th percentile {row['wall_ms'][1]:.0f} ms; of the processor's time {row['processor_ms'][0]:.1f} and "
            f"{row['processor_ms'][1]:.0f} ms; medians in ms: {stages}"
        )
    if "memory_mb" in row:
        remarks.append(f"{row['memory_mb']:.0f} MB")
    return "; ".join(remarks)
