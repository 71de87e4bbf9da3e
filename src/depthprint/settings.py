"""Settings of an encoder: what is coded, with which atoms, and how codes become clusters and distances."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from depthprint.errors import SettingsError

__all__ = ["EncoderSettings", "PolarSettings", "StreamSettings"]

ViewName = Literal["raw-depth", "depth", "normals", "pairs", "polar"]
AtomKind = Literal["image", "patch"]
ClusterKind = Literal["atoms", "patches", "cells"]


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class PolarSettings(_Frozen):
    """Bird's-eye grid about the sensor: sectors over the field of view, rings of ``ring_m`` metres.

    With ``full_circle`` the sectors cover 360 degrees whatever the sensor sees, and wrap.
    """

    sectors: int = 24
    rings: int = 20
    ring_m: float = 2.0
    ring_growth: float = 1.0
    full_circle: bool = False
    ground_clearance_m: float = 0.4
    max_height_m: float = 6.0
    low_band_m: tuple[float, float] = (1.5, 3.0)
    high_band_m: tuple[float, float] = (3.0, 9.0)
    smoothing: float = 0.7


class StreamSettings(_Frozen):
    """One view of the image, coded with one dictionary into one signature.

    view: 'raw-depth' (metres, holes filled), 'depth' (relative), 'normals', 'polar' or 'pairs' (of surface points).
    channels: channels of a polar view ('height', 'low-count', 'high-count', 'count', 'line-cos', 'line-sin'), or of
        pairs, by their lengths in 'metres' or in 'sizes' of the object.
    size: the view is brought to size x size pixels; a polar view has its own grid.
    atoms, patch_shape, stride: whole-image or patch atoms; a 0 in patch_shape means the whole extent.
    n_atoms, n_nonzero: dictionary size, and atoms per image or patch.
    dictionary: 'learned' (eq. 1-2), 'omp' (trained by pursuit), 'random' (training patches), 'parametric', or
        'pixels': one atom a pixel, all of them taken, whatever n_atoms and n_nonzero say: no coding.
    centre: subtract each patch's mean from each of its channels first.
    clusters: 'atoms' (the picked atoms), 'patches' (one a patch), 'cells' (codes max-pooled over cells).
    cells, cell_overlap: grids of cells; a cell is ``cell_overlap`` times its pitch.
    root: replace a coefficient c by sign(c) sqrt|c| before pooling.
    point_dims: appearance of a cluster is projected on this many principal directions.
    mass: weight of a cluster, its norm or 1.
    position_weight, depth_weight: scale of the position in [0, 1] and of the mean depth among the coordinates.
    masses, form, cap: the EMD's treatment of unequal masses, the NCD, and the ground distance's ceiling.
    weight: weight of this stream in the combined distance, a weighted mean.
    """

    view: ViewName
    channels: tuple[str, ...] = ()
    size: int = 96
    smoothing: float = 1.5
    atoms: AtomKind = "patch"
    patch_shape: tuple[int, int] = (8, 8)
    stride: int = 2
    n_atoms: int = 256
    n_nonzero: int = 4
    dictionary: Literal["learned", "omp", "random", "parametric", "pixels"] = "learned"
    pursuit: Literal["omp", "ols", "mp"] = "omp"
    centre: bool = False
    clusters: ClusterKind = "cells"
    cells: tuple[int, ...] = (4,)
    cell_overlap: float = 1.5
    root: bool = False
    signed: bool = True
    point_dims: int = 64
    mass: Literal["norm", "unit"] = "norm"
    position_weight: float = 3.0
    depth_weight: float = 0.0
    masses: Literal["null", "rubner", "balanced"] = "null"
    form: Literal["joint", "information", "steinhaus"] = "information"
    cap: float = 2.0
    weight: float = 1.0

    @model_validator(mode="after")
    def _consistent(self) -> StreamSettings:
        if self.atoms == "image" and self.clusters != "atoms":
            raise ValueError("image atoms have no positions: clusters must be 'atoms'")
        if self.view in ("polar", "pairs") and not self.channels:
            raise ValueError(f"a view of {self.view} needs its channels named")
        return self


class EncoderSettings(_Frozen):
    """A named combination of streams.

    max_shift: sectors by which a polar view is shifted to either side in search of the least distance; with
        ``polar.full_circle`` every sector is tried.
    view_shift, view_shift_steps: a view in perspective is shifted by this share of its width and height, so many
        times (x, y) to either side, in search of the least distance.
    mirror: object views are also compared mirrored, and the smaller distance counts.
    """

    name: str
    streams: tuple[StreamSettings, ...]
    polar: PolarSettings = PolarSettings()
    max_shift: int = 0
    view_shift: float = 1 / 12
    view_shift_steps: tuple[int, int] = (0, 0)
    mirror: bool = False
    seed: int = 0

    @property
    def stream_weights(self) -> tuple[float, ...]:
        """Shares of the streams in the combined distance; they add up to 1."""
        total = sum(stream.weight for stream in self.streams)
        return tuple(stream.weight / total for stream in self.streams)

    @classmethod
    def parse(cls, values: Any) -> EncoderSettings:
        """Build settings from plain values; an unknown key or a wrong value raises SettingsError naming it."""
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"]) or "settings"
            raise SettingsError(f"{where}: {first['msg']}, got {first.get('input')!r}") from None
