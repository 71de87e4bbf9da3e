"""Train the FAB-MAP models that ship, on simulated worlds alone: tools/train_shipped_fabmap.py [PRESET ...].

The frames are those of tools/train_shipped_models.py: no seed is used by the demo, the tests or the evaluation.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

import cv2
from train_shipped_models import MODELS

from depthprint.baselines.fabmap.depth_picture import DepthPicture
from depthprint.baselines.fabmap.model import train_fabmap
from depthprint.baselines.fabmap.model_file import save_fabmap
from depthprint.baselines.fabmap.settings import FabMapSettings
from depthprint.range_image import RangeImage
from depthprint.simulation.training import room_frames, street_frames


def _settings(contrast: float) -> FabMapSettings:
    return FabMapSettings(cluster_size=0.5, contrast=contrast)


# preset: training frames, how depth is drawn, and the settings; contrast so low that some hundred features are found
TRAINING: dict[str, tuple[Callable[[], list[RangeImage]], DepthPicture, FabMapSettings]] = {
    "street": (
        lambda: street_frames("stereo", 150)[::3],
        DepthPicture(2.0, 50.0, width=480, smoothing=0.5),
        _settings(0.01),
    ),
    "lidar": (
        lambda: street_frames("lidar", 120)[::3],
        DepthPicture(2.0, 80.0, width=720, smoothing=0.5),
        _settings(0.01),
    ),
    "laser": (
        lambda: street_frames("laser", 300)[::6],
        DepthPicture(1.0, 40.0, smoothing=1.0),
        _settings(0.01),
    ),
    "handheld": (lambda: room_frames(150)[::3], DepthPicture(0.5, 6.0, smoothing=0.5), _settings(0.005)),
}


def main(presets: Sequence[str]) -> None:
    """Train and save the named presets, all by default."""
    cv2.setNumThreads(1)
    for preset in presets or TRAINING:
        started = time.perf_counter()
        frames, picture, settings = TRAINING[preset]
        images = frames()
        model = train_fabmap([picture(image) for image in images], settings)
        path = save_fabmap(model, picture, MODELS / f"fabmap-{preset}.npz")
        print(
            f"{path.name}: {len(images)} simulated images, {len(model.tree)} words, "
            f"{path.stat().st_size // 1024} KiB, {time.perf_counter() - started:.0f} s"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
