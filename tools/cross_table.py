"""Learn dictionaries from one world, score them on another: tools/cross_table.py OUT.json DATA ...

DATA: recordings with poses, or pose files along which a street is simulated (every fourth frame). Each is scored, by
``emd`` of its own preset, with dictionaries learned from the simulated worlds of the shipped models, and from every
recording itself, without labels. Rows of the printed table say where a dictionary was learned, columns where it was
scored: average precision / recall@1. Planar scans teach dictionaries of planar scans alone.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from depthprint.complexity_recognizer import ComplexityRecognizer
from depthprint.datasets.base import RangeSequence
from depthprint.datasets.registry import open_sequence
from depthprint.datasets.simulated_street import simulated_street
from depthprint.encoder import Encoder
from depthprint.evaluation.ground_truth import loop_ground_truth
from depthprint.evaluation.loops import evaluate_loops
from depthprint.io.atomic import atomic_path
from depthprint.presets import is_planar, preset_settings
from depthprint.range_image import RangeImage
from depthprint.simulation.training import spread_frames, training_images

FRAMES = 240
STREET_STEP = 4
SIMULATED = {
    "street": "simulated towns, stereo",
    "handheld": "simulated rooms",
    "laser": "simulated towns, laser",
}

Cells = dict[str, dict[str, tuple[float, float]]]


def open_data(path: Path) -> tuple[str, RangeSequence]:
    """A recording, or the street along a pose file, with its name."""
    if path.suffix == ".txt":
        name = f"simulated street along KITTI {path.stem}"
        return name, simulated_street(poses_file=path, every=STREET_STEP)
    sequence = open_sequence(path)
    return sequence.name.split("/")[-1], sequence


def cross_table(data: dict[str, RangeSequence]) -> Cells:
    """Average precision and recall@1 by where a dictionary was scored, then by where it was learned."""
    worlds: dict[str, tuple[str, Callable[[], list[RangeImage]]]] = {}
    for preset, name in SIMULATED.items():
        worlds[name] = preset, lambda preset=preset: training_images(preset)
    for name, sequence in data.items():
        worlds[name] = sequence.preset, lambda sequence=sequence: spread_frames(sequence, FRAMES)
    cells: Cells = {}
    for scored, sequence in data.items():
        settings = preset_settings(sequence.preset)
        truth = loop_ground_truth(sequence, sequence.truth)
        cells[scored] = {}
        for learned, (preset, images) in worlds.items():
            if is_planar(preset_settings(preset)) and not is_planar(settings):
                continue
            recognizer = ComplexityRecognizer(Encoder(settings).fit(images()))
            (method,) = evaluate_loops(sequence, {"emd": recognizer}, truth, resamples=2)
            metrics = method.metrics
            cells[scored][learned] = metrics.average_precision, metrics.recall_at_1
            print(
                f"{learned} -> {scored}: {metrics.average_precision:.3f} / {metrics.recall_at_1:.3f}",
                flush=True,
            )
    return cells


def markdown(cells: Cells) -> str:
    """The cells as a table; a dictionary scored where it was learned is in brackets."""
    learned = list(dict.fromkeys(name for column in cells.values() for name in column))
    lines = ["| learned from \\ scored on | " + " | ".join(cells) + " |", "|---" * (len(cells) + 1) + "|"]
    for row in learned:
        texts = []
        for scored, column in cells.items():
            text = "{:.3f} / {:.3f}".format(*column[row]) if row in column else "-"
            texts.append(f"[{text}]" if row == scored else text)
        lines.append(f"| {row} | " + " | ".join(texts) + " |")
    return "\n".join(lines)


def main(out: Path, paths: list[Path]) -> None:
    """Write the cells as JSON, and print them as a table."""
    cells = cross_table(dict(open_data(path) for path in paths))
    with atomic_path(out) as temporary:
        temporary.write_text(json.dumps(cells, indent=2))
    print(markdown(cells))


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Path(argument) for argument in sys.argv[2:]])
