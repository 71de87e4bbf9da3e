"""Local features of an 8-bit image: SIFT, as unit RootSIFT descriptors."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["SiftFeatures", "root_sift"]


class SiftFeatures:
    """The ``n_features`` strongest SIFT features of a grey image (Lowe, IJCV 2004; OpenCV's implementation).

    contrast: least contrast of a feature, SIFT's own threshold (0.04 there; drawn depth is smoother than a photograph).
    upright: features keep the image's own orientation, which tells more where the camera does not roll.
    """

    def __init__(self, n_features: int, *, upright: bool = True, contrast: float = 0.02) -> None:
        if n_features < 1 or not contrast > 0:
            raise SettingsError(
                f"SiftFeatures: expected n_features >= 1 and contrast > 0, got {n_features} and {contrast}"
            )
        self._n_features = n_features
        self._upright = upright
        self._contrast = contrast
        self._detector: Any = None

    def __call__(self, picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
        """Describe a (height, width) uint8 image: (n, 128) float32 unit vectors; n is 0 where nothing stands out."""
        if picture.ndim != 2 or picture.dtype != np.uint8:
            raise DataError(
                f"SiftFeatures: expected a grey (height, width) uint8 image, got {picture.dtype} {picture.shape}"
            )
        if self._detector is None:
            import cv2

            create: Any = cv2.SIFT_create  # type: ignore[attr-defined]
            self._detector = create(nfeatures=self._n_features, contrastThreshold=self._contrast)
        keypoints = list(self._detector.detect(picture, None))
        if self._upright:
            keypoints = _upright(keypoints)
        # the detector keeps ties beyond its number
        strongest = np.argsort([-k.response for k in keypoints], kind="stable")[: self._n_features]
        _, descriptors = self._detector.compute(picture, [keypoints[i] for i in np.sort(strongest)])
        if descriptors is None:
            return np.zeros((0, 128), dtype=np.float32)
        return root_sift(np.asarray(descriptors))


def _upright(keypoints: list[Any]) -> list[Any]:
    """One keypoint for each place and size, whatever the orientations found there, turned upright."""
    found = {(k.pt, k.size): k for k in keypoints}
    for keypoint in found.values():
        keypoint.angle = 0.0
    return list(found.values())


def root_sift(descriptors: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Square roots of L1-normalised SIFT vectors (Arandjelovic & Zisserman, CVPR 2012): unit rows."""
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    return np.asarray(np.sqrt(descriptors / total), dtype=np.float32)
