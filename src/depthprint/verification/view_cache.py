"""ViewCache: several methods that check the same frame share its view."""

from __future__ import annotations

from depthprint.range_image import RangeImage
from depthprint.verification.depth_view import DepthView, make_depth_view

__all__ = ["ViewCache"]


class ViewCache:
    """Views of the last frame seen: called with a frame, it makes its view once."""

    def __init__(self) -> None:
        self._image: RangeImage | None = None
        self._view: DepthView | None = None

    def __call__(self, image: RangeImage) -> DepthView:
        """The frame's view; raises as ``make_depth_view``."""
        if self._view is None or self._image is not image:
            self._view = make_depth_view(image)
            self._image = image
        return self._view
