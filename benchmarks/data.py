"""What all comparisons run on: a simulated drive, encoded once and kept in ``benchmarks/data``."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from depthprint import (
    Encoder,
    Pinhole,
    RangeImage,
    RangeSequence,
    Signature,
    SignatureBatch,
    load_shipped_encoder,
    open_sequence,
)
from depthprint.io.atomic import atomic_path
from depthprint.patches import extract_patches
from depthprint.presets import preset_settings
from depthprint.settings import EncoderSettings, StreamSettings
from depthprint.views import make_view

__all__ = [
    "GAP",
    "N_PLACES",
    "N_PLACES_QUICK",
    "N_QUERIES",
    "Street",
    "load_frames",
    "load_images",
    "load_patches",
    "load_street",
]

DRIVE_SEED = 20
N_PLACES = 4541  # as many as KITTI's sequence 00 has frames
N_PLACES_QUICK = 400
GAP = 100
N_QUERIES = 300

_FOLDER = Path(__file__).parent / "data"
_LENGTH_M = 4000.0
_SHORT_M = 400.0
Part = TypeVar("Part")


@dataclass(frozen=True)
class Street:
    """Signatures of a simulated drive: the street preset's two streams, mass the norm of a cluster."""

    height: SignatureBatch
    counts: SignatureBatch

    def __len__(self) -> int:
        return len(self.height)


def load_street(n_places: int) -> Street:
    """Signatures of the first places of the drive, the gap and the frames that follow it."""
    n = n_places + GAP + N_QUERIES
    path = _FOLDER / f"street-{DRIVE_SEED}-{n}.npz"
    if not path.exists():
        parts = _in_two_processes(_street_part, n)
        streams = [SignatureBatch.stack([s for part in parts for s in part[stream]]) for stream in (0, 1)]
        arrays = {
            f"{name}_{key}": getattr(batch, key)
            for name, batch in zip(("height", "counts"), streams, strict=True)
            for key in ("weights", "points", "counts")
        }
        with atomic_path(path) as temporary:
            np.savez(temporary, **arrays)
    with np.load(path, allow_pickle=False) as kept:
        height, counts = (
            SignatureBatch(kept[f"{name}_weights"], kept[f"{name}_points"], kept[f"{name}_counts"], "street")
            for name in ("height", "counts")
        )
    return Street(height, counts)


def load_images(n: int) -> npt.NDArray[np.float32]:
    """(n, 9216) raw depth in metres of the drive's frames, 96 x 96, as the literal preset codes it."""
    path = _FOLDER / f"images-{DRIVE_SEED}-{n}.npy"
    if not path.exists():
        with atomic_path(path) as temporary:
            np.save(temporary, np.concatenate(_in_two_processes(_images_part, n)))
    return np.asarray(np.load(path, allow_pickle=False))


def load_frames(seed: int, n: int) -> list[RangeImage]:
    """The first n frames of a drive of 400 metres through the town of ``seed``, which has loops after some 100."""
    path = _FOLDER / f"frames-{seed}-{n}.npz"
    if not path.exists():
        drive = open_sequence(dataset="simulated-street", seed=seed, length_m=_SHORT_M)
        frames = [drive[i] for i in range(n)]
        camera = asdict(frames[0].projection)
        with atomic_path(path) as temporary:
            np.savez_compressed(
                temporary,
                ranges_m=np.stack([frame.ranges_m for frame in frames]),
                sensor_height_m=np.array(frames[0].sensor_height_m, dtype=np.float64),
                **camera,
            )
    with np.load(path, allow_pickle=False) as kept:
        projection = Pinhole(**{field.name: kept[field.name].item() for field in fields(Pinhole)})
        height_m = float(kept["sensor_height_m"])
        return [RangeImage(one, projection, sensor_height_m=height_m) for one in kept["ranges_m"]]


def load_patches(n: int) -> SignatureBatch:
    """Signatures of n frames with 121 clusters each: 11 x 11 patches of relative depth, coded by random patches."""
    stream = StreamSettings(
        view="depth", size=192, patch_shape=(16, 16), stride=8, n_nonzero=3, clusters="patches", dictionary="random",
        point_dims=20, position_weight=1.0,
    )  # fmt: skip
    training, drive = _drive(DRIVE_SEED + 1), _drive(DRIVE_SEED)
    encoder = Encoder(EncoderSettings(name="patches", streams=(stream,)))
    encoder.fit([training[i] for i in range(0, 400, 20)])
    frames = [drive[i] for i in range(0, 20 * n, 20)]
    return SignatureBatch.stack([encoding.signatures[0] for encoding in encoder.describe_many(frames)])


def _drive(seed: int) -> RangeSequence:
    return open_sequence(dataset="simulated-street", seed=seed, length_m=_LENGTH_M)


def _street_part(frames: tuple[int, int]) -> list[list[Signature]]:
    shipped = load_shipped_encoder("street")
    streams = tuple(stream.model_copy(update={"mass": "norm"}) for stream in shipped.settings.streams)
    encoder = Encoder(shipped.settings.model_copy(update={"streams": streams}), shipped.streams)
    drive = _drive(DRIVE_SEED)
    encodings = [encoder.describe(drive[i]) for i in range(*frames)]
    return [[encoding.signatures[stream] for encoding in encodings] for stream in (0, 1)]


def _images_part(frames: tuple[int, int]) -> npt.NDArray[np.float32]:
    settings = preset_settings("literal")
    stream = settings.streams[0]
    drive = _drive(DRIVE_SEED)
    return np.concatenate(
        [extract_patches(make_view(drive[i], stream, settings), stream).vectors for i in range(*frames)]
    )


def _in_two_processes(work: Callable[[tuple[int, int]], Part], n: int) -> list[Part]:
    # A fresh interpreter each: neither inherits the threads of this one.
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        return list(pool.map(work, [(0, n // 2), (n // 2, n)]))
