"""What every comparison of signatures shares: its named choices, their checks, the kernels' array layout."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from depthprint.errors import ConvergenceError, DataError, FingerprintError, SettingsError
from depthprint.signature import GroundDistance, SignatureBatch

if TYPE_CHECKING:
    from depthprint._kernels.ground import PairRules, Side

__all__ = [
    "ROUNDING",
    "Form",
    "Masses",
    "check_alike",
    "check_form",
    "check_masses",
    "check_status",
    "closed_under_negation",
    "pair_rules",
    "refuse_empty",
    "shift_table",
    "side_arrays",
]

FloatArray = npt.NDArray[np.float64]
Masses = Literal["null", "rubner", "balanced"]
Form = Literal["joint", "information", "steinhaus"]

# Bounds are sums in floating point; nothing within rounding of what counts is dismissed.
ROUNDING = 1.0 + 1e-12


def check_masses(masses: str) -> None:
    if masses not in get_args(Masses):
        raise SettingsError(f"masses: expected one of {', '.join(get_args(Masses))}, got {masses!r}")


def check_form(form: str | None) -> None:
    if form is not None and form not in get_args(Form):
        raise SettingsError(f"form: expected None or one of {', '.join(get_args(Form))}, got {form!r}")


def check_alike(name_p: str, d_p: int, name_q: str, d_q: int, ground: GroundDistance) -> None:
    if name_p != name_q:
        raise FingerprintError(
            f"signatures of different models cannot be compared: {name_p!r} and {name_q!r}; "
            "encode both with one model"
        )
    if d_p != d_q:
        raise DataError(f"expected points of one dimension, got {d_p} and {d_q}")
    if ground.position_dims > d_p:
        raise DataError(f"expected points of at least {ground.position_dims} position dimensions, got {d_p}")


def check_status(status: npt.NDArray[np.int64]) -> None:
    """Raise unless every problem was solved to the optimum."""
    failed = np.flatnonzero(status)
    if len(failed):
        raise ConvergenceError(
            f"the transportation simplex stopped before the optimum in {len(failed)} of {len(status)} "
            f"problems (status {int(status[failed[0]])}); please report the signatures"
        )


def shift_table(shifts: Any, ground: GroundDistance) -> FloatArray:
    """Validated offsets (S, position_dims); one zero offset when None."""
    if shifts is None:
        return np.zeros((1, ground.position_dims))
    table = np.array(shifts, dtype=np.float64, order="C")
    if table.ndim != 2 or not len(table) or table.shape[1] != ground.position_dims:
        raise SettingsError(
            f"shifts: expected (S, {ground.position_dims}) position offsets, got {table.shape}"
        )
    if not np.isfinite(table).all():
        raise SettingsError("shifts: offsets must be finite")
    return table


def closed_under_negation(shifts: FloatArray) -> bool:
    """Whether the least over the shifts is the same both ways round."""
    gaps = np.abs(shifts[:, None, :] + shifts[None, :, :]).max(axis=2, initial=0.0)
    return bool((gaps.min(axis=1) <= 1e-12 * np.abs(shifts).max(initial=0.0)).all())


def pair_rules(masses: str, form: str | None, ground: GroundDistance) -> PairRules:
    from depthprint._kernels.ground import PairRules

    return PairRules(
        ground.position_dims,
        0.0 if ground.period is None else float(ground.period),
        float(ground.cap),
        float(ground.null_cost) if masses == "null" else 0.0,
        masses == "balanced",
        masses == "rubner",
        0 if form is None else 1 + get_args(Form).index(form),
    )


def side_arrays(batch: SignatureBatch, masses: str, ground: GroundDistance, *, right: bool) -> Side:
    """Copy a batch into the kernels' layout; a unit of mass has K(X) = null_cost (eq. 18)."""
    from depthprint._kernels.ground import Side

    weights = np.array(batch.weights, order="C")
    total = weights.sum(axis=1)
    if not np.isfinite(total).all():
        raise DataError(f"signature {int(np.argmin(np.isfinite(total)))}: the total weight overflows")
    if masses == "balanced":
        weights /= np.where(total > 0, total, 1.0)[:, None]
        total = (total > 0).astype(np.float64)
    complexity = ground.null_cost * (total if masses == "null" else (total > 0))
    points = batch.points.transpose(0, 2, 1) if right else batch.points
    return Side(weights, np.array(points, order="C"), np.array(batch.counts), total, complexity)


def refuse_empty(left: FloatArray, right: FloatArray, masses: str) -> None:
    for side, values in (("first", left), ("second", right)):
        if (values == 0).any():
            raise DataError(
                f"signature {int(np.argmin(values))} of the {side} batch is empty, which "
                f"{masses!r} masses do not define"
            )
