"""One query of a trained recogniser of objects among 3000 stored views, against HOG and a linear machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from benchmarks.harness import Comparison, Settings, interleaved_s, threads, version
from depthprint import RangeImage, load_shipped_encoder
from depthprint.objects.trained_recogniser import TrainedRecogniser
from depthprint.simulation.objects import simulated_objects

__all__ = ["NAMES", "run"]

NAMES = ("recognise",)
OBJECTS_SEED = 41
N_STORED = 3000
N_QUERIES = 60
ROUNDS = 3


def run(settings: Settings, wanted: set[str]) -> list[Comparison]:
    """The row, where asked for: the median of the queries' medians, each query asked in turns with the peer."""
    if "recognise" not in wanted:
        return []
    from sklearn.svm import LinearSVC

    from depthprint.baselines.hog import hog_features

    n_categories, n_instances, frames = (3, 2, 1) if settings.quick else (12, 5, 4)
    objects = simulated_objects(
        n_categories=n_categories, n_instances=n_instances, frames=frames, seed=OBJECTS_SEED
    )
    views = objects.views
    last = f"_{n_instances}"
    learned = [v for v in views if not v.instance.endswith(last)]
    asked = [v for v in views if v.instance.endswith(last)]
    asked = asked[:: max(1, len(asked) // N_QUERIES)]
    images, queries = ([objects.read(v) for v in some] for some in (learned, asked))
    labels, truth = [v.category for v in learned], [v.category for v in asked]
    encoder = load_shipped_encoder("object")
    recogniser = TrainedRecogniser.fit(encoder, images, labels, groups=[v.instance for v in learned])
    recogniser = _with_stored(recogniser, len(images) if settings.quick else N_STORED)
    contestants: dict[str, Callable[[RangeImage], str | None]] = {
        "ours": lambda image: recogniser.recognise(image).classes[0][0]
    }
    note = ""
    try:
        machine = LinearSVC(random_state=0).fit(hog_features(images)[0], labels)
        contestants["peer"] = lambda image: str(machine.predict(hog_features([image])[0])[0])
    except ImportError as error:
        note = f"no ready-made wheel for this Python: {error}"
    with threads(settings.threads):
        taken = [
            interleaved_s({name: partial(ask, image) for name, ask in contestants.items()}, rounds=ROUNDS)
            for image in queries
        ]
        busy_s = []
        for image in queries:
            started = time.process_time()
            recogniser.recognise(image)
            busy_s.append(time.process_time() - started)
    seconds = {name: np.array([turn[name] for turn in taken]) for name in contestants}
    right = {
        name: np.mean([ask(q) == t for q, t in zip(queries, truth, strict=True)])
        for name, ask in contestants.items()
    }
    slow_s = float(np.percentile(seconds["ours"], 90))
    remarks = [
        note,
        f"90th percentile {1e3 * slow_s:.1f} ms",
        f"of the processor's time {1e3 * np.median(busy_s):.1f} ms",
        f"right in {right['ours']:.0%} of {len(queries)} queries",
    ]
    if "peer" in right:
        remarks.append(f"the peer in {right['peer']:.0%}")
    return [
        Comparison(
            "recognise", float(np.median(seconds["ours"])),
            float(np.median(seconds["peer"])) if "peer" in seconds else None,
            "HOG + LinearSVC", version("scikit-image"), settings.threads,
            f"{len(recogniser.stored.views)} stored views of {n_categories} classes", "query",
            ", ".join(part for part in remarks if part),
            {"query_s_90": slow_s, "processor_s": float(np.median(busy_s))},
        )
    ]  # fmt: skip


def _with_stored(recogniser: TrainedRecogniser, n: int) -> TrainedRecogniser:
    """The recogniser with its views stored again and again up to ``n``, which cost a query what others would."""
    stored = recogniser.stored
    rows = np.arange(n) % len(stored.views)
    views = stored.views.taken(rows)
    return TrainedRecogniser(
        recogniser.encoder,
        replace(
            stored, views=views, geometry=None if stored.geometry is None else stored.geometry.taken(rows)
        ),
        _taken(recogniser.view_labels, rows),
        _taken(recogniser.sources, rows),
        recogniser.calibration,
    )


def _taken(values: Sequence[str], rows: npt.NDArray[np.int64]) -> list[str]:
    return [values[row] for row in rows]
