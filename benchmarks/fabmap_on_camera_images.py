"""FAB-MAP 2.0 on a folder of camera images with a loop matrix, to see that the baseline is as good as known.

    python benchmarks/fabmap_on_camera_images.py IMAGES TRUTH.mat --train 0:230,460:690 --score 230:460,690:920

Vocabulary and tree are learned from the frames of --train; the queries of --score are asked of every frame more than
--gap older. A matrix may be narrower than the images allow: --tolerance takes a match that many frames beside a
positive one.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from depthprint.baselines.fabmap.belief import FabMap
from depthprint.baselines.fabmap.model import train_fabmap
from depthprint.baselines.fabmap.posterior import log_odds_against
from depthprint.baselines.fabmap.settings import FabMapSettings
from depthprint.errors import DataError
from depthprint.evaluation.ground_truth import POSITIVE, TruthMatrix, read_loop_matrix
from depthprint.evaluation.metrics import QueryOutcomes, bootstrap_intervals, loop_metrics


def read_picture(path: Path) -> npt.NDArray[np.uint8]:
    """Grey image (h, w) uint8; DataError naming a file that is none."""
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise DataError(f"{path}: expected an image, got a file that cannot be decoded")
    return np.asarray(picture, dtype=np.uint8)


def frames_of(text: str, n: int) -> npt.NDArray[np.int64]:
    """Frame numbers of ranges such as 0:230,460:690."""
    chosen = np.zeros(n, dtype=bool)
    for part in text.split(","):
        start, _, stop = part.partition(":")
        chosen[int(start) : int(stop or n)] = True
    return np.flatnonzero(chosen)


def widened(truth: TruthMatrix, tolerance: int) -> TruthMatrix:
    """The matrix with every positive spread over the candidates ``tolerance`` frames beside it."""
    values = np.array(truth.values)
    query, match = np.nonzero(truth.values == POSITIVE)
    for step in range(-tolerance, tolerance + 1):
        values[query, np.clip(match + step, 0, len(truth) - 1)] = POSITIVE
    return TruthMatrix(values, truth.gap, f"{truth.rule}; matches within {tolerance} frames of a positive")


def main() -> None:
    """Learn, drive, score."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("images", type=Path)
    parser.add_argument("truth", type=Path)
    parser.add_argument("--train", required=True)
    parser.add_argument("--score", required=True)
    parser.add_argument("--every", type=int, default=2, help="take every k-th training frame")
    parser.add_argument("--gap", type=int, default=50)
    parser.add_argument("--tolerance", type=int, nargs="+", default=[0])
    parser.add_argument("--settings", type=json.loads, default={}, help="JSON fields of FabMapSettings")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    paths = sorted(p for p in options.images.iterdir() if p.suffix.lower() in (".jpg", ".png", ".pgm"))
    pictures = [read_picture(path) for path in paths]
    settings = FabMapSettings(**options.settings)
    started = time.process_time()
    train = frames_of(options.train, len(paths))[:: options.every]
    model = train_fabmap([pictures[i] for i in train], settings)
    print(
        f"{settings}\n{len(model.tree)} words from {len(train)} images, {time.process_time() - started:.0f} s"
    )
    matches, scores = np.full(len(paths), -1), np.full(len(paths), np.nan)
    drive = FabMap(model)
    started = time.process_time()
    for frame, picture in enumerate(pictures):
        words = model.words(picture)
        belief = drive.locate(words, max(0, frame - options.gap))
        if len(belief.log_places):
            against = log_odds_against(belief.log_new, belief.log_places, settings.neighbours)
            matches[frame], scores[frame] = int(against.argmin()), -float(against.min())
        drive.follow(belief)
        drive.add(words)
    print(f"{1e3 * (time.process_time() - started) / len(paths):.1f} ms a frame, features included")
    scored = frames_of(options.score, len(paths))
    scored = scored[scored > options.gap]
    for tolerance in options.tolerance:
        truth = widened(read_loop_matrix(options.truth, options.gap), tolerance)
        outcomes = np.where(matches >= 0, truth.values[np.arange(len(paths)), matches], 0)
        queries = QueryOutcomes(scores[scored], outcomes[scored], truth.has_positive[scored])
        figures = asdict(loop_metrics(queries))
        low, high = bootstrap_intervals(queries, 0, resamples=500)["recall_at_100_precision"]
        shown = ", ".join(f"{name} {value:.3f}" for name, value in figures.items() if "threshold" not in name)
        print(
            f"tolerance {tolerance}: {int(queries.has_positive.sum())} of {len(queries)} queries to find: {shown}; "
            f"R@100P in [{low:.3f}, {high:.3f}]"
        )


if __name__ == "__main__":
    main()
