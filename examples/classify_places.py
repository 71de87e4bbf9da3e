"""Name the stretch of a drive from one view: classify_places.py [--frames N] [SEQUENCE_FOLDER].

Frames of a simulated street, or of a recording (such as 7-Scenes RedKitchen), are cut into stretches. A recogniser
learns them from every other frame and names the stretch of the frames between. Simulated unless a folder is given.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from depthprint import TrainedRecogniser, load_shipped_encoder, open_sequence

STRETCHES = 6


def main() -> None:
    """Train on one half of the frames, and score the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", help="a recording; the simulated street when absent")
    parser.add_argument("--frames", type=int, default=120, help="how many frames to take")
    options = parser.parse_args()
    if options.folder is None:
        sequence = open_sequence(dataset="simulated-street", seed=5)
    else:
        sequence = open_sequence(options.folder)
    taken = np.linspace(0, len(sequence) - 1, options.frames).astype(int)
    images = [sequence[int(frame)] for frame in taken]
    stretches = [f"stretch {k * STRETCHES // len(taken) + 1}" for k in range(len(taken))]
    encoder = load_shipped_encoder(sequence.preset)
    recogniser = TrainedRecogniser.fit(encoder, images[::2], stretches[::2])
    found = [recogniser.recognise(image) for image in images[1::2]]
    right = [f.classes[0][0] == truth for f, truth in zip(found, stretches[1::2], strict=True)]
    unknown = sum(f.label is None for f in found)
    kind = "simulated" if sequence.simulated else "recorded"
    sys.stdout.write(
        f"{sequence.name} ({kind}), preset {sequence.preset}: {sum(right)} of {len(right)} views in their stretch "
        f"(chance {len(right) / STRETCHES:.0f}), {unknown} taken for none of them\n"
    )


if __name__ == "__main__":
    main()
