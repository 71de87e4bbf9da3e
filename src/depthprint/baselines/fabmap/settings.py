"""Settings of FAB-MAP: what is learned, and the constants of its probabilities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from depthprint.errors import SettingsError

__all__ = ["FabMapSettings"]


@dataclass(frozen=True)
class FabMapSettings:
    """Constants of FAB-MAP 2.0; the defaults are those of the published programs but for SIFT's own scale.

    n_features: strongest SIFT features kept an image. upright: they keep the image's own orientation. contrast: the
        least that counts as a feature.
    cluster_size: descriptors nearer than this share a word; on the scale of unit RootSIFT vectors.
    information_bound: pairs of words with less mutual information (nats) are no edges of the tree.
    p_seen_if_there, p_seen_if_not: the detector, P(z=1|e=1) and P(z=1|e=0).
    new_place: 'sampled' takes the training images for the places never visited; 'mean-field' their average.
    tree: false drops the word's parent (naive Bayes).
    p_new: weight of the new place in the prior. motion_bias: 0 expects old places to be
        driven through forward, 1 backward, 0.5 either way.
    motion: false takes every old place for equally likely before each frame.
    keep: share of the posterior that is kept, the rest is spread evenly.
    neighbours: a place's probability includes that of this many places before and after it, for maps whose
        frames overlap.

    Raises SettingsError for values that cannot be.
    """

    n_features: int = 300
    upright: bool = True
    contrast: float = 0.02
    cluster_size: float = 0.55
    information_bound: float = 0.0005
    p_seen_if_there: float = 0.39
    p_seen_if_not: float = 0.0
    new_place: Literal["sampled", "mean-field"] = "sampled"
    tree: bool = True
    p_new: float = 0.9
    motion_bias: float = 0.5
    motion: bool = True
    keep: float = 0.99
    neighbours: int = 0

    def __post_init__(self) -> None:
        for name in ("n_features", "neighbours"):
            value = getattr(self, name)
            least = 1 if name == "n_features" else 0
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise SettingsError(f"FabMapSettings: expected a whole {name} >= {least}, got {value!r}")
        if not self.contrast > 0:
            raise SettingsError(f"FabMapSettings: expected contrast > 0, got {self.contrast}")
        if not self.cluster_size > 0 or not self.information_bound >= 0:
            raise SettingsError(
                "FabMapSettings: expected cluster_size > 0 and information_bound >= 0, "
                f"got {self.cluster_size} and {self.information_bound}"
            )
        if not 0 <= self.p_seen_if_not < self.p_seen_if_there < 1:
            raise SettingsError(
                "FabMapSettings: expected 0 <= p_seen_if_not < p_seen_if_there < 1, "
                f"got {self.p_seen_if_not} and {self.p_seen_if_there}"
            )
        if not (0 < self.p_new < 1 and 0 <= self.motion_bias <= 1 and 0 < self.keep <= 1):
            raise SettingsError(
                "FabMapSettings: expected p_new in (0, 1), motion_bias in [0, 1] and keep in (0, 1], "
                f"got {self.p_new}, {self.motion_bias} and {self.keep}"
            )
        if self.new_place not in ("sampled", "mean-field"):
            raise SettingsError(
                f"FabMapSettings: expected new_place 'sampled' or 'mean-field', got {self.new_place!r}"
            )
