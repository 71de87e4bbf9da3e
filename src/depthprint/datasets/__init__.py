"""Loaders, one file a data set; ``open_sequence`` and ``open_objects`` find the right one."""

from __future__ import annotations

from depthprint.datasets.base import LoopTruth, ObjectSet, ObjectView, RangeSequence
from depthprint.datasets.frames import require_frames
from depthprint.datasets.registry import OBJECT_SETS, SEQUENCES, guess_dataset, open_objects, open_sequence

__all__ = [
    "OBJECT_SETS",
    "SEQUENCES",
    "LoopTruth",
    "ObjectSet",
    "ObjectView",
    "RangeSequence",
    "guess_dataset",
    "open_objects",
    "open_sequence",
    "require_frames",
]
