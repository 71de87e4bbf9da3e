"""``python -m benchmarks``: run the comparisons, print the table, write results.json, the plot and BENCHMARKS.md."""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.families import FAMILIES, names_of, run_family

HERE = Path(__file__).parent


def main() -> None:
    """Run what was asked for, each family in a process of its own, one after the other."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="small sizes: does everything run, not how fast it is"
    )
    parser.add_argument(
        "--only", action="append", metavar="NAME", help="only this comparison; may be repeated"
    )
    parser.add_argument(
        "--threads", type=int, default=2, help="threads of those that use several (default: 2)"
    )
    parser.add_argument("--out", type=Path, default=HERE / "results.json", help="file of the results")
    options = parser.parse_args()
    known = {name: family for family in FAMILIES for name in names_of(family)}
    unknown = set(options.only or ()) - set(known)
    if unknown:
        parser.error(f"--only: expected {', '.join(known)}, got {', '.join(sorted(unknown))}")
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[variable] = str(options.threads)
    os.environ["OMP_WAIT_POLICY"] = (
        "passive"  # a thread that spins takes a busy machine's other core from its peer
    )

    from benchmarks import report
    from benchmarks.plots import plot_scaling

    results: dict[str, Any] = {}
    for family in FAMILIES:
        wanted = {name for name in names_of(family) if not options.only or name in options.only}
        if not wanted:
            continue
        started = time.perf_counter()
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            found = pool.submit(run_family, family, wanted, options.quick, options.threads).result()
        rows = {str(row.pop("name")): row for row in found}
        results = report.write_results(options.out, rows, options.quick)
        print(f"{family}: {', '.join(sorted(wanted))} in {time.perf_counter() - started:.0f} s", flush=True)

    print(report.table(results))
    if options.quick:
        return
    report.write_page(HERE.parent / "BENCHMARKS.md", results)
    if "scaling" in results:
        plot_scaling(results["scaling"], HERE / "scaling.png")


if __name__ == "__main__":
    main()
