"""Whether a machine has the memory for what methods compare: known before hours are spent."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from depthprint.errors import DataError
from depthprint.evaluation.object_methods import ObjectMethod

__all__ = ["PairwiseMethod", "machine_bytes", "require_room_for_pairs"]

_GB = 1e9


@runtime_checkable
class PairwiseMethod(Protocol):
    """An ``ObjectMethod`` that keeps matrices of all pairs of views."""

    @property
    def bytes_per_pair(self) -> float:
        """Memory at its peak over the square of the number of views, about."""


def machine_bytes() -> int | None:
    """Memory of this machine, None where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def require_room_for_pairs(
    name: str, methods: Sequence[ObjectMethod], n_views: int, available: int | None
) -> None:
    """Refuse more views than a method can compare in pairs in so many bytes; None: unknown, and nothing is refused.

    Raises DataError that names the data set, the method, what it would take and how many views it could take.
    """
    pairwise = [
        (method.bytes_per_pair, method.name) for method in methods if isinstance(method, PairwiseMethod)
    ]
    if available is None or not pairwise:
        return
    most, method = max(pairwise)
    needed = most * n_views**2
    if needed <= available:
        return
    limit = int(math.sqrt(available / most))
    raise DataError(
        f"{name}: {n_views} views are too many for method {method!r}, which compares all pairs: expected {limit} or "
        f"fewer on a machine of {available / _GB:.0f} GB, since they would take about {needed / _GB:.0f} GB; take one "
        f"view in {math.ceil(n_views / limit)} (every, frames), or methods that compare no pairs"
    )
