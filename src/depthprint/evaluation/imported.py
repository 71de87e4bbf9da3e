"""Matches that other programs wrote to a file, scored by the same rule as our own methods."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from depthprint.errors import DataError
from depthprint.evaluation.ground_truth import TruthMatrix
from depthprint.evaluation.loop_record import LoopRecord
from depthprint.evaluation.loops import MethodLoops, score_records

__all__ = ["ImportedMatch", "read_match_file", "score_matches"]

_COLUMNS = ("query", "match", "score")


@dataclass(frozen=True)
class ImportedMatch:
    """What a program named for a query; larger ``score`` is surer."""

    query: int
    match: int
    score: float


def read_match_file(path: Path | str, truth: TruthMatrix) -> dict[int, ImportedMatch]:
    """Read a CSV file with the columns query, match and score, at most one row a query; others are left alone.

    Frames count from 0, in the order of the sequence. A row whose match is empty or negative names none, as does a
    query without a row. A column 'distance' (smaller is surer), as in our own files of matches, serves as score.
    Raises DataError naming file and line for anything else, a match that is no candidate of its query included.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: expected a CSV file of matches, got {error}") from error
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    header = [name.strip() for name in reader.fieldnames or ()]
    reader.fieldnames = header
    score = "score" if "score" in header else "distance"
    if "query" not in header or "match" not in header or score not in header:
        raise DataError(
            f"{path}: expected the columns {', '.join(_COLUMNS)}, got {', '.join(header) or 'nothing'}"
        )
    found: dict[int, ImportedMatch] = {}
    try:
        for row in reader:
            where = f"{path}, line {reader.line_num}"
            matched = _read_row(row, score, truth, where)
            if matched is None:
                continue
            if matched.query in found:
                raise DataError(
                    f"{where}: expected one row a query, got a second one of query {matched.query}"
                )
            found[matched.query] = matched
    except csv.Error as error:
        raise DataError(
            f"{path}, line {reader.line_num}: expected a CSV file of matches, got {error}"
        ) from error
    return found


def score_matches(
    name: str, matches: dict[int, ImportedMatch], truth: TruthMatrix, seed: int = 0, resamples: int = 1000
) -> MethodLoops:
    """Score a program's matches as a method named ``name``; its times are not known (NaN)."""
    has_positive = truth.has_positive
    records = []
    for query in range(len(truth)):
        if not truth.candidates(query):
            continue
        found = matches.get(query)
        if found is None:
            records.append(LoopRecord(query, -1, math.nan, None, 0, bool(has_positive[query])))
        else:
            outcome = int(truth.values[query, found.match])
            records.append(
                LoopRecord(query, found.match, -found.score, None, outcome, bool(has_positive[query]))
            )
    return score_records(name, records, seed, resamples)


def _read_row(row: dict[str, str], score: str, truth: TruthMatrix, where: str) -> ImportedMatch | None:
    if None in row or None in row.values():
        raise DataError(f"{where}: expected as many cells as the header has columns")
    query = _frame(row["query"], "query", where)
    if not 0 <= query < len(truth):
        raise DataError(f"{where}: expected a query in 0..{len(truth) - 1}, got {query}")
    match = -1 if not row["match"].strip() else _frame(row["match"], "match", where)
    if match < 0:
        return None
    if match >= truth.candidates(query):
        raise DataError(
            f"{where}: expected a match over {truth.gap} frames older than query {query}, got {match}"
        )
    try:
        value = float(row[score])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataError(f"{where}: expected a finite {score}, got {row[score]!r}")
    return ImportedMatch(query, match, value if score == "score" else -value)


def _frame(text: str, column: str, where: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise DataError(f"{where}: expected a whole {column}, got {text!r}") from None
