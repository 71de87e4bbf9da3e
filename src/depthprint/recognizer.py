"""PlaceRecognizer: the one protocol of every method that recognises places, ours and the baselines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy.typing as npt

from depthprint.range_image import RangeImage

if TYPE_CHECKING:
    from depthprint.verification.verifier import Verification

__all__ = ["PlaceMatch", "PlaceRecognizer", "ReconsideringRecognizer", "StorableRecognizer"]


@dataclass(frozen=True)
class PlaceMatch:
    """A stored place proposed for a query; smaller ``distance`` is more alike. ``shift`` is in columns or None.

    ``verification`` is the outcome of the geometric check, where one was made.
    """

    place: int
    distance: float
    shift: float | None = None
    verification: Verification | None = None


class PlaceRecognizer(Protocol):
    """Places are numbered 0, 1, ... in the order of ``add``.

    ``describe`` is pure; a description is opaque and may be queried and added any number of times.
    ``query`` looks at the places below ``limit`` only (all when None) and returns up to k matches, best first.
    """

    def fit(self, images: Sequence[RangeImage]) -> PlaceRecognizer:
        """Learn whatever is learned (dictionary, vocabulary) from frames disjoint from what will be scored."""

    def describe(self, image: RangeImage) -> Any:
        """Make the description of one frame."""

    def add(self, description: Any) -> int:
        """Store a place and return its number."""

    def query(self, description: Any, k: int = 1, limit: int | None = None) -> list[PlaceMatch]:
        """Nearest stored places."""

    def distance(self, first: Any, second: Any) -> float:
        """Distance of two descriptions: what ``query`` minimises, unless it weighs the whole map or earlier frames."""


@runtime_checkable
class ReconsideringRecognizer(PlaceRecognizer, Protocol):
    """A PlaceRecognizer that can answer for one of the last frames again, once it knows what came after it."""

    def reconsider(self, number: int, k: int = 1) -> list[PlaceMatch]:
        """Nearest stored places, below the query's limit, of a frame that was queried and added as place ``number``."""


@runtime_checkable
class StorableRecognizer(PlaceRecognizer, Protocol):
    """A PlaceRecognizer whose descriptions can be kept in a place database."""

    @property
    def fingerprint(self) -> str:
        """Names the model; descriptions of equal fingerprints compare."""

    def pack(self, description: Any) -> dict[str, npt.NDArray[Any]]:
        """Take a description apart into named arrays of numbers."""

    def unpack(self, arrays: Mapping[str, npt.NDArray[Any]]) -> Any:
        """Put together what ``pack`` took apart, bit for bit; other arrays are left alone."""
