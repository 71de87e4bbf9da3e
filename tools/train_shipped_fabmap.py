"""Train the FAB-MAP models that ship, on simulated worlds alone: tools/train_shipped_fabmap.py [PRESET ...].

The frames are those of tools/train_shipped_models.py: no seed is used by the demo, the tests or the evaluation.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

import cv2
from train_shipped_models import MODELS, room_frames, street_frames

from depthprint.baselines.fabmap.depth_picture import DepthPicture
from depthprint.baselines.fabmap.model import train_fabmap
from depthprint.baselines.fabmap.model_file import save_fabmap
from depthprint.baselines.fabmap.settings import FabMapSettings
from depthprint.range_image import RangeImage

# preset: training frames, how depth is drawn, and the settings, chosen on simulated drives scored nowhere
TRAINING: dict[str, tuple[Callable[[], list[RangeImage]], DepthPicture, FabMapSettings]] = {
    "street": (
        lambda: street_frames("stereo", 150),
        DepthPicture(2.0, 50.0),
        FabMapSettings(cluster_size=0.6),
    ),
    "lidar": (
        lambda: street_frames("lidar", 150),
        DepthPicture(2.0, 80.0, width=720),
        FabMapSettings(cluster_size=0.6),
    ),
    "laser": (
        lambda: street_frames("laser", 300),
        DepthPicture(1.0, 40.0, smoothing=1.5),
        FabMapSettings(cluster_size=0.6),
    ),
    "handheld": (lambda: room_frames(200), DepthPicture(0.5, 6.0), FabMapSettings(cluster_size=0.6)),
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
