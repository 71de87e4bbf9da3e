"""Local features of an 8-bit image: SIFT, as unit RootSIFT descriptors."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from depthprint.errors import DataError, SettingsError

__all__ = ["SiftFeatures", "root_sift"]

# Lower than SIFT's default of 0.04: rendered depth is smoother than a photograph.
_CONTRAST = 0.02


class SiftFeatures:
    """The ``n_features`` strongest SIFT features of a grey image (Lowe, IJCV 2004; OpenCV's implementation)."""

    def __init__(self, n_features: int, contrast: float = _CONTRAST) -> None:
        if n_features < 1 or not contrast > 0:
            raise SettingsError(
                f"SiftFeatures: expected n_features >= 1 and contrast > 0, got {n_features} and {contrast}"
            )
        self._n_features = n_features
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
        keypoints, descriptors = self._detector.detectAndCompute(picture, None)
        if descriptors is None:
            return np.zeros((0, 128), dtype=np.float32)
        # the detector keeps ties beyond its number
        strongest = np.argsort([-k.response for k in keypoints], kind="stable")[: self._n_features]
        return root_sift(np.asarray(descriptors)[np.sort(strongest)])


def root_sift(descriptors: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Square roots of L1-normalised SIFT vectors (Arandjelovic & Zisserman, CVPR 2012): unit rows."""
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    return np.asarray(np.sqrt(descriptors / total), dtype=np.float32)
