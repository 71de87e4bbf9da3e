"""The four kernel descriptors by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.gradient import gradient_descriptors, gradient_pair
from depthprint.baselines.kernel_descriptors.lbp import lbp_descriptors, lbp_pair
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors
from depthprint.baselines.kernel_descriptors.size import size_descriptors, size_of_points
from depthprint.baselines.kernel_descriptors.spin import spin_descriptors, spin_of_points
from depthprint.errors import SettingsError
from depthprint.range_image import RangeImage

__all__ = ["KINDS", "DescriptorKind", "describe_crops", "descriptor_kind"]

Progress = Callable[[int, int], None]
Float32Array = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]
Pair = tuple[PatchDescriptors, PatchDescriptors]


@dataclass(frozen=True)
class DescriptorKind:
    """One descriptor.

    describe: (image, masked) -> descriptors. match_gamma: width of the efficient match kernel. describe_pair:
    (image, masked) -> those of the image and of its mirror image; None where descriptors are made of distances and
    angles alone, which a mirror leaves as they are. These are described from points: (depth, points) -> descriptors.
    """

    describe: Callable[[RangeImage, bool], PatchDescriptors]
    match_gamma: float
    describe_pair: Callable[[RangeImage, bool], Pair] | None = None
    of_points: Callable[[Float32Array, FloatArray], PatchDescriptors] | None = None

    @property
    def mirror_free(self) -> bool:
        """Whether the descriptors of a mirror image are those of the image."""
        return self.describe_pair is None


KINDS = {
    "gradient": DescriptorKind(gradient_descriptors, 0.001, gradient_pair),
    "lbp": DescriptorKind(lbp_descriptors, 0.1, lbp_pair),
    "spin": DescriptorKind(spin_descriptors, 0.1, of_points=spin_of_points),
    "size": DescriptorKind(size_descriptors, 1.0, of_points=size_of_points),
}


def descriptor_kind(name: str) -> DescriptorKind:
    """The descriptor of a name; SettingsError for one that there is not."""
    if name not in KINDS:
        raise SettingsError(f"kernel descriptor: expected one of {', '.join(KINDS)}, got {name!r}")
    return KINDS[name]


def describe_crops(
    images: Sequence[RangeImage], kind: str, *, masked: bool = False, progress: Progress | None = None
) -> list[PatchDescriptors]:
    """Descriptors of crops in order, on as many threads as numba may use.

    masked: leave out the depth around the object. Raises DataError (naming the frame) for other than pinhole
    images, SettingsError for an unknown kind.
    """
    from depthprint._kernels.blocks import for_blocks

    describe = descriptor_kind(kind).describe
    described: list[PatchDescriptors | None] = [None] * len(images)

    def block(start: int, stop: int) -> None:
        described[start:stop] = [describe(images[number], masked) for number in range(start, stop)]

    for_blocks(len(images), 8, block, progress)
    return [crop for crop in described if crop is not None]
