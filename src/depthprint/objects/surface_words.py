"""Fixed vocabularies of kernel descriptors: the shape and size of small surfaces as one vector of a view."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthprint.baselines.kernel_descriptors.kinds import KINDS, describe_crops
from depthprint.baselines.kernel_descriptors.match_features import (
    Vocabulary,
    learn_vocabulary,
    match_rows,
    power_transform,
)
from depthprint.baselines.kernel_descriptors.patch_grid import PatchDescriptors, depth_and_points
from depthprint.baselines.kernel_descriptors.spin import PATCH_PX
from depthprint.errors import DepthprintError, ModelError, SettingsError
from depthprint.io.archive import DAMAGED, read_archive, write_archive
from depthprint.objects.kernels import unit_rows
from depthprint.projection import Pinhole
from depthprint.range_image import RangeImage

__all__ = ["SurfaceWords"]

Float32Array = npt.NDArray[np.float32]
Progress = Callable[[int, int], None]

FORMAT = "depthprint surface words"
FORMAT_VERSION = 2
POINTS_MARGIN_PX = 20
# Kinds whose patches are centred all over the object, however thin it is: chosen on objects of training folds, where
# patterns did better on the crop as it comes.
MARGINS_PX = {"gradient": 12, "spin": POINTS_MARGIN_PX, "size": POINTS_MARGIN_PX}
SHIPPED = Path(__file__).parents[1] / "models" / "object-surfaces.npz"


@dataclass(frozen=True)
class SurfaceWords:
    """Words of each kind of kernel descriptor, learned once from simulated objects and the same for every data set.

    Words that do not depend on the views compared make a view's vector a property of the view alone.
    """

    vocabularies: Mapping[str, Vocabulary]

    @classmethod
    def learn(cls, images: Sequence[RangeImage], n_words: int = 256, seed: int = 0) -> SurfaceWords:
        """Learn ``n_words`` of each kind from masked crops; raises as describe_crops and learn_vocabulary do."""
        learned = {}
        for kind in KINDS:
            crops = _describe(images, kind)
            words = learn_vocabulary(crops, KINDS[kind].match_gamma, n_words=n_words, seed=seed).words
            # As the file holds them, so that a saved vocabulary gives the same features.
            learned[kind] = Vocabulary.of(words.astype(np.float32), KINDS[kind].match_gamma)
        return cls(learned)

    def only(self, kind: str) -> SurfaceWords:
        """The words of one kind; SettingsError for a kind that is not there."""
        if kind not in self.vocabularies:
            raise SettingsError(
                f"surface words: expected one of {', '.join(self.vocabularies)}, got {kind!r}"
            )
        return SurfaceWords({kind: self.vocabularies[kind]})

    def features(
        self, images: Sequence[RangeImage], *, mirror: bool = True, progress: Progress | None = None
    ) -> tuple[Float32Array, Float32Array]:
        """Unit vectors (n, d) of masked pinhole crops in metres, and of their mirror images.

        Kinds have equal shares. Without ``mirror`` the second are the first. Raises DataError (naming the frame) for
        other than pinhole images.
        Source: Bo, Ren and Fox, NIPS 2010 and IROS 2011; power transform as their classifier has it.
        """
        from depthprint._kernels.blocks import for_blocks

        rows = np.empty((1 + mirror, len(images), self.n_features), dtype=np.float32)

        def block(start: int, stop: int) -> None:
            for number in range(start, stop):
                parts = [self.part(images[number], kinds, mirror) for kinds in self.groups]
                rows[:, number] = self.joined(parts)

        for_blocks(len(images), 8, block, progress)
        straight = rows[0]
        return straight, rows[1] if mirror else straight

    @property
    def groups(self) -> list[tuple[str, ...]]:
        """Kinds that have work in common, which ``part`` does once."""
        apart = [(kind,) for kind in self.vocabularies if KINDS[kind].of_points is None]
        of_points = tuple(kind for kind in self.vocabularies if KINDS[kind].of_points is not None)
        return [*apart, *([of_points] if of_points else [])]

    def part(self, image: RangeImage, kinds: Sequence[str], mirror: bool) -> list[Float32Array]:
        """Unit vectors (1 or 2, d) by kinds of one group, of an image and of its mirror image where asked for."""
        described = _described(image, kinds, mirror)
        return [_unit_features(described[kind], self.vocabularies[kind]) for kind in kinds]

    def joined(self, parts: Sequence[Sequence[Float32Array]]) -> Float32Array:
        """Unit vectors (1 or 2, d) of an image from what ``part`` gave for each of ``groups``."""
        rows = dict(zip([kind for kinds in self.groups for kind in kinds], chain(*parts), strict=True))
        return unit_rows(np.concatenate([rows[kind] for kind in self.vocabularies], axis=1))

    @property
    def n_features(self) -> int:
        """Length of a view's vector."""
        return sum(vocabulary.n_features for vocabulary in self.vocabularies.values())

    def parts(self) -> tuple[dict[str, float], dict[str, npt.NDArray[np.float32]]]:
        """What a file holds of the words: widths of the match kernels, and words (w, k), by kind."""
        kinds = self.vocabularies.items()
        return {k: v.gamma for k, v in kinds}, {k: v.words.astype(np.float32) for k, v in kinds}

    @classmethod
    def of_parts(
        cls, gammas: Mapping[str, float], words: Mapping[str, npt.NDArray[np.floating]]
    ) -> SurfaceWords:
        """The words that ``parts`` took apart; raises KeyError, SettingsError or DataError where they do not fit."""
        return cls({kind: Vocabulary.of(words[kind], gammas[kind]) for kind in KINDS if kind in gammas})

    def save(self, path: Path | str) -> Path:
        """Write the words to one .npz file, without pickle; it appears whole or not at all."""
        gammas, words = self.parts()
        write_archive(path, {"format": FORMAT, "version": FORMAT_VERSION, "gammas": gammas}, words)
        return Path(path)

    @classmethod
    def load(cls, path: Path | str = SHIPPED) -> SurfaceWords:
        """Read words, by default those that ship; another or a damaged file raises ModelError naming it."""
        header, arrays = read_archive(path, "surface words", FORMAT, FORMAT_VERSION)
        try:
            return cls.of_parts(header["gammas"], arrays)
        except (*DAMAGED, DepthprintError) as error:
            raise ModelError(f"{path}: expected whole surface words, got {error}") from error


def _unit_features(crops: Sequence[PatchDescriptors], vocabulary: Vocabulary) -> Float32Array:
    return unit_rows(power_transform(match_rows(crops, vocabulary)))


def _described(
    image: RangeImage, kinds: Sequence[str], mirror: bool
) -> dict[str, Sequence[PatchDescriptors]]:
    """Descriptors of an image, and of its mirror image where asked for, by kind."""
    found: dict[str, Sequence[PatchDescriptors]] = {}
    geometry: tuple[Float32Array, npt.NDArray[np.float64]] | None = None
    for name in kinds:
        kind, margin_px = KINDS[name], MARGINS_PX.get(name)
        if kind.of_points is not None:
            if geometry is None:
                geometry = depth_and_points(_framed(image, POINTS_MARGIN_PX), PATCH_PX, masked=True)
            straight = kind.of_points(*geometry)
            found[name] = (straight, straight.mirrored())[: 1 + mirror]
            continue
        framed = image if margin_px is None else _framed(image, margin_px)
        if mirror and kind.describe_pair is not None:
            found[name] = kind.describe_pair(framed, True)
        else:
            found[name] = (kind.describe(framed, True),)
    return found


def _describe(
    images: Sequence[RangeImage], kind: str, progress: Progress | None = None
) -> list[PatchDescriptors]:
    if kind in MARGINS_PX:
        images = [_framed(image, MARGINS_PX[kind]) for image in images]
    return describe_crops(images, kind, masked=True, progress=progress)


def _framed(image: RangeImage, margin_px: int) -> RangeImage:
    """The object's box with a margin of pixels without return, so that patches centre on its border as well."""
    camera = image.projection
    if image.mask is None or not isinstance(camera, Pinhole) or not (image.mask & image.valid).any():
        return image
    rows, columns = np.flatnonzero(image.mask.any(1)), np.flatnonzero(image.mask.any(0))
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    ranges_m = np.pad(image.ranges_m[box], margin_px, constant_values=np.nan)
    height, width = ranges_m.shape
    framed = replace(
        camera,
        cx=camera.cx - float(columns[0]) + margin_px,
        cy=camera.cy - float(rows[0]) + margin_px,
        width=width,
        height=height,
    )
    return image.replace(ranges_m=ranges_m, projection=framed, mask=np.pad(image.mask[box], margin_px))
