"""Exact Earth Mover's Distance between signatures (paper eq. 11-17), pair by pair and as a difference matrix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from depthprint.errors import ConvergenceError, DataError, FingerprintError, SettingsError
from depthprint.signature import GroundDistance, Signature, SignatureBatch

if TYPE_CHECKING:
    from depthprint._kernels.bounds import PairRules, Side

__all__ = ["EMDResult", "Form", "Masses", "difference_matrix", "emd", "emd_from_costs"]

FloatArray = npt.NDArray[np.float64]
Masses = Literal["null", "rubner", "balanced"]
Form = Literal["joint", "information", "steinhaus"]

_PAIRS_PER_CALL = 4096
_CELLS_PER_TASK = 6400


@dataclass(frozen=True)
class EMDResult:
    """``value`` is the distance; ``work`` the cost of the flow, ``flow_mass`` its mass (both after normalising masses).

    ``flow`` (m, n) is there when asked for, without the surplus. ``surplus`` is the mass that went from p to the
    null element, negative when it came from there to q; always 0 for balanced masses.
    """

    value: float
    work: float
    flow_mass: float
    surplus: float
    flow: FloatArray | None = None


def emd(
    p: Signature,
    q: Signature,
    *,
    masses: Masses = "null",
    ground: GroundDistance | None = None,
    shift: npt.ArrayLike | None = None,
    return_flow: bool = False,
) -> EMDResult:
    """Exact EMD of two signatures (paper eq. 11-17).

    ``masses``: `null`, the surplus of the heavier goes to the null element at ``ground.null_cost`` a unit and the value
    is the total work, a metric on unequal masses; `rubner`, eq. 11-16 as printed, work over flow; `balanced`, both
    normalised to mass 1. ``shift`` (position_dims,) is added to the position coordinates of p, in their units.
    ``ground`` is `GroundDistance()` when None. Exact up to rounding: some 1e-15 of mass times largest cost.

    Raises FingerprintError for signatures of two models, DataError for points of unequal dimension or one empty
    signature where ``masses`` is not `null` (its complexity is not a flow), ConvergenceError if not optimal.
    """
    ground = GroundDistance() if ground is None else ground
    _check_masses(masses)
    _check_alike(p.fingerprint, p.points.shape[1], q.fingerprint, q.points.shape[1], ground)
    from depthprint._kernels.bounds import ground_costs

    offset = _shift_table(None if shift is None else [shift], ground)[0]
    costs = np.empty((len(p), len(q)))
    rules = _pair_rules(masses, None, ground)
    ground_costs(p.points.copy(), q.points.T.copy(), len(p), len(q), offset, rules, costs)
    return emd_from_costs(
        p.weights, q.weights, costs, masses=masses, null_cost=ground.null_cost, return_flow=return_flow
    )


def emd_from_costs(
    weights_p: npt.ArrayLike,
    weights_q: npt.ArrayLike,
    costs: npt.ArrayLike,
    *,
    masses: Masses = "null",
    null_cost: float = 1.0,
    return_flow: bool = False,
) -> EMDResult:
    """Exact EMD of weights (m,) and (n,) under a cost matrix (m, n), all finite and >= 0; see `emd`.

    Only the surplus goes to the null element, whatever the costs; for costs up to twice ``null_cost`` nothing else
    could gain by it. Raises DataError for bad arrays, ConvergenceError if not optimal.
    """
    _check_masses(masses)
    if not (np.isfinite(null_cost) and null_cost >= 0):
        raise SettingsError(f"emd: expected a finite null_cost >= 0, got {null_cost}")
    p = _non_negative("weights_p", weights_p, 1)
    q = _non_negative("weights_q", weights_q, 1)
    c = _non_negative("costs", costs, 2)
    if c.shape != (len(p), len(q)):
        raise DataError(f"emd: expected costs {(len(p), len(q))} for these weights, got {c.shape}")
    mass_p, mass_q = float(p.sum()), float(q.sum())
    if not (np.isfinite(mass_p) and np.isfinite(mass_q)):
        raise DataError("emd: the total weight overflows; scale the weights down")
    empty = (mass_p == 0) + (mass_q == 0)
    if empty == 1 and masses != "null":
        raise DataError(
            f"emd: one signature is empty (masses {mass_p:g}, {mass_q:g}), which {masses!r} masses do not define"
        )
    if masses == "balanced" and not empty:
        p, q = p / mass_p, q / mass_q
        mass_p = mass_q = 1.0
    work, flow = 0.0, np.zeros(c.shape)
    if empty < 2:
        from depthprint._kernels.transport import solve_pair

        surplus_cost = null_cost if masses == "null" else 0.0
        work, status, flow = solve_pair(p, q, c, surplus_cost, masses == "balanced")
        _check_status(np.array([status]))
    flow_mass = min(mass_p, mass_q)
    value = work / flow_mass if masses == "rubner" and flow_mass > 0 else work
    flow.setflags(write=False)
    return EMDResult(float(value), float(work), flow_mass, mass_p - mass_q, flow if return_flow else None)


def difference_matrix(
    a: SignatureBatch,
    b: SignatureBatch | None = None,
    *,
    masses: Masses = "null",
    ground: GroundDistance | None = None,
    form: Form | None = None,
    shifts: npt.ArrayLike | None = None,
    below: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> FloatArray:
    """Exact distances (n, m) of all signatures of ``a`` to all of ``b``, or among themselves when ``b`` is None.

    ``form`` None gives the EMD, else the normalised distance of that form (see `depthprint.ncd`); there an empty
    signature has complexity 0 and distance 1 to any other. ``shifts`` (S, position_dims): the least over these offsets
    of a's positions. ``below``: larger distances are returned as inf, most of them unsolved. Parallel over pairs; the
    result does not depend on the number of threads.

    Raises FingerprintError, DataError (dimensions; an empty signature where ``masses`` is not `null` and ``form`` is
    None), SettingsError, ConvergenceError.
    """
    ground = GroundDistance() if ground is None else ground
    _check_masses(masses)
    _check_form(form)
    other = a if b is None else b
    _check_alike(a.fingerprint, a.points.shape[2], other.fingerprint, other.points.shape[2], ground)
    offsets = _shift_table(shifts, ground)
    if below is not None and np.isnan(below):
        raise SettingsError("difference_matrix: below must be a number, got nan")
    from depthprint._kernels.bounds import difference_tasks

    left = _side(a, masses, ground, right=False)
    right = _side(other, masses, ground, right=True)
    if form is None and masses != "null":
        _refuse_empty(left.masses, right.masses, masses)
    symmetric = b is None and _closed_under_negation(offsets)
    rules = _pair_rules(masses, form, ground)
    limit = np.inf if below is None else float(below)
    out = np.empty((len(a), len(other)))
    total = len(a) * (len(a) + 1) // 2 if symmetric else out.size
    step = max(1, _CELLS_PER_TASK // (left.weights.shape[1] * right.weights.shape[1]))
    tasks: list[FloatArray] = []
    pending = done = 0
    for i in range(len(a)):
        starts = np.arange(i if symmetric else 0, len(other), step)
        tasks.append(np.stack([np.full_like(starts, i), starts, np.minimum(starts + step, len(other))], axis=1))
        pending += len(other) - (i if symmetric else 0)
        if pending >= _PAIRS_PER_CALL or i == len(a) - 1:
            _check_status(difference_tasks(left, right, np.concatenate(tasks), offsets, limit, rules, out))
            done, pending, tasks = done + pending, 0, []
            if progress is not None:
                progress(done, total)
    if symmetric:
        for i in range(len(a)):
            out[i + 1 :, i] = out[i, i + 1 :]
    return out


def _check_masses(masses: str) -> None:
    if masses not in get_args(Masses):
        raise SettingsError(f"masses: expected one of {', '.join(get_args(Masses))}, got {masses!r}")


def _check_form(form: str | None) -> None:
    if form is not None and form not in get_args(Form):
        raise SettingsError(f"form: expected None or one of {', '.join(get_args(Form))}, got {form!r}")


def _check_alike(name_p: str, d_p: int, name_q: str, d_q: int, ground: GroundDistance) -> None:
    if name_p != name_q:
        raise FingerprintError(
            f"signatures of different models cannot be compared: {name_p!r} and {name_q!r}; encode both with one model"
        )
    if d_p != d_q:
        raise DataError(f"expected points of one dimension, got {d_p} and {d_q}")
    if ground.position_dims > d_p:
        raise DataError(f"expected points of at least {ground.position_dims} position dimensions, got {d_p}")


def _check_status(status: npt.NDArray[np.int64]) -> None:
    """Raise unless every problem was solved to the optimum."""
    failed = np.flatnonzero(status)
    if len(failed):
        raise ConvergenceError(
            f"the transportation simplex stopped before the optimum in {len(failed)} of {len(status)} problems "
            f"(status {int(status[failed[0]])}); please report the signatures"
        )


def _non_negative(name: str, values: npt.ArrayLike, ndim: int) -> FloatArray:
    array = np.array(values, dtype=np.float64, order="C")
    if array.ndim != ndim:
        raise DataError(f"emd: expected {name} of {ndim} dimensions, got shape {array.shape}")
    if not (np.isfinite(array).all() and (array >= 0).all()):
        raise DataError(f"emd: {name} must be finite and >= 0")
    return array


def _shift_table(shifts: Any, ground: GroundDistance) -> FloatArray:
    """Validated offsets (S, position_dims); one zero offset when None."""
    if shifts is None:
        return np.zeros((1, ground.position_dims))
    table = np.array(shifts, dtype=np.float64, order="C")
    if table.ndim != 2 or not len(table) or table.shape[1] != ground.position_dims:
        raise SettingsError(f"shifts: expected (S, {ground.position_dims}) position offsets, got {table.shape}")
    if not np.isfinite(table).all():
        raise SettingsError("shifts: offsets must be finite")
    return table


def _closed_under_negation(shifts: FloatArray) -> bool:
    """Whether the least over the shifts is the same both ways round."""
    gaps = np.abs(shifts[:, None, :] + shifts[None, :, :]).max(axis=2, initial=0.0)
    return bool((gaps.min(axis=1) <= 1e-12 * np.abs(shifts).max(initial=0.0)).all())


def _pair_rules(masses: str, form: str | None, ground: GroundDistance) -> PairRules:
    from depthprint._kernels.bounds import PairRules

    return PairRules(
        ground.position_dims,
        0.0 if ground.period is None else float(ground.period),
        float(ground.cap),
        float(ground.null_cost) if masses == "null" else 0.0,
        masses == "balanced",
        masses == "rubner",
        0 if form is None else 1 + get_args(Form).index(form),
    )


def _side(batch: SignatureBatch, masses: str, ground: GroundDistance, *, right: bool) -> Side:
    """Copy a batch into the kernels' layout; K(X) of eq. 18 is a unit of mass times null_cost unless `null`."""
    from depthprint._kernels.bounds import Side

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


def _refuse_empty(left: FloatArray, right: FloatArray, masses: str) -> None:
    for side, values in (("first", left), ("second", right)):
        if (values == 0).any():
            raise DataError(
                f"signature {int(np.argmin(values))} of the {side} batch is empty, which {masses!r} masses do not define"
            )
