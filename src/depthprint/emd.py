"""Exact Earth Mover's Distance between signatures (paper eq. 11-17), by pairs and as a difference matrix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthprint._pairs import (
    Form,
    Masses,
    check_alike,
    check_form,
    check_masses,
    check_status,
    closed_under_negation,
    pair_rules,
    refuse_empty,
    shift_table,
    side_arrays,
)
from depthprint.errors import DataError, SettingsError
from depthprint.signature import GroundDistance, Signature, SignatureBatch

__all__ = [
    "EMDResult",
    "Form",
    "Masses",
    "difference_matrix",
    "emd",
    "emd_from_costs",
    "emd_pairs",
    "emd_pairs_from_costs",
    "ground_distances",
]

FloatArray = npt.NDArray[np.float64]

_PAIRS_PER_CALL = 4096
_CELLS_PER_TASK = 6400
# Fewer are solved on the calling thread: others would be woken for little, and spin before they sleep again.
_PAIRS_WORTH_THREADS = 64


@dataclass(frozen=True)
class EMDResult:
    """``value`` is the distance, ``work`` the cost of the flow, ``flow_mass`` its mass.

    Work and masses are those after normalising, where masses are balanced.

    ``flow`` (m, n) is there when asked for, without the surplus. ``surplus`` is the mass that went from p to
    the null element, negative when it came from there to q; always 0 for balanced masses.
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

    ``masses``: `null`, the surplus of the heavier goes to the null element at ``ground.null_cost`` a unit and
    the value is the total work, a metric on unequal masses; `rubner`, eq. 11-16 as printed, work over flow;
    `balanced`, both normalised to mass 1. ``shift`` (position_dims,) is added to the position coordinates of
    p, in their units. ``ground`` is `GroundDistance()` when None. Exact up to rounding: some 1e-15 of mass
    times largest cost.

    Raises FingerprintError for signatures of two models, DataError for points of unequal dimension or one
    empty signature where ``masses`` is not `null` (its complexity is not a flow), ConvergenceError if not
    optimal.
    """
    ground = GroundDistance() if ground is None else ground
    check_masses(masses)
    costs = ground_distances(p, q, ground, shift)
    return emd_from_costs(
        p.weights, q.weights, costs, masses=masses, null_cost=ground.null_cost, return_flow=return_flow
    )


def ground_distances(
    p: Signature, q: Signature, ground: GroundDistance, shift: npt.ArrayLike | None = None
) -> FloatArray:
    """Ground distances (m, n) between the clusters of p, whose positions are moved by ``shift``, and of q.

    Raises FingerprintError and DataError as `emd`.
    """
    check_alike(p.fingerprint, p.points.shape[1], q.fingerprint, q.points.shape[1], ground)
    from depthprint._kernels.ground import ground_costs

    offset = shift_table(None if shift is None else [shift], ground)[0]
    costs = np.empty((len(p), len(q)))
    rules = pair_rules("null", None, ground)
    ground_costs(p.points.copy(), q.points.T.copy(), len(p), len(q), offset, rules, costs)
    return costs


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

    Only the surplus goes to the null element, whatever the costs; for costs up to twice ``null_cost`` nothing
    else could gain by it. Raises DataError for bad arrays, ConvergenceError if not optimal.
    """
    check_masses(masses)
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
            f"emd: one signature is empty (masses {mass_p:g}, {mass_q:g}), "
            f"which {masses!r} masses do not define"
        )
    if masses == "balanced" and not empty:
        p, q = p / mass_p, q / mass_q
        mass_p = mass_q = 1.0
    work, flow = 0.0, np.zeros(c.shape)
    if empty < 2:
        from depthprint._kernels.transport import solve_pair

        surplus_cost = null_cost if masses == "null" else 0.0
        work, status, flow = solve_pair(p, q, c, surplus_cost, masses == "balanced")
        check_status(np.array([status]))
    flow_mass = min(mass_p, mass_q)
    value = work / flow_mass if masses == "rubner" and flow_mass > 0 else work
    flow.setflags(write=False)
    return EMDResult(float(value), float(work), flow_mass, mass_p - mass_q, flow if return_flow else None)


def emd_pairs(
    first: SignatureBatch,
    second: SignatureBatch,
    *,
    masses: Masses = "null",
    ground: GroundDistance | None = None,
    form: Form | None = None,
    shift: npt.ArrayLike | None = None,
) -> FloatArray:
    """Exact distances (n,) of first[i] to second[i], one after the other on the calling thread.

    Arguments and values as in `difference_matrix`, with one ``shift`` (position_dims,). Raises as it does, and
    DataError for batches of unequal length.
    """
    ground = GroundDistance() if ground is None else ground
    check_masses(masses)
    check_form(form)
    if len(first) != len(second):
        raise DataError(f"emd_pairs: expected batches of one length, got {len(first)} and {len(second)}")
    check_alike(first.fingerprint, first.points.shape[2], second.fingerprint, second.points.shape[2], ground)
    offset = shift_table(None if shift is None else [shift], ground)[0]
    from depthprint._kernels.pairs import solve_run

    left = side_arrays(first, masses, ground, right=False)
    right = side_arrays(second, masses, ground, right=True)
    if form is None and masses != "null":
        refuse_empty(left.masses, right.masses, masses)
    n = len(left.counts)
    distances, status, solved = np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64)
    solve_run(
        left, right, 0, n, np.zeros(n, np.int64), np.full(n, np.inf), offset[None], pair_rules(masses, form, ground),
        distances, status, solved,
    )  # fmt: skip
    check_status(status)
    return distances


def emd_pairs_from_costs(
    weights_p: npt.ArrayLike,
    weights_q: npt.ArrayLike,
    costs: npt.ArrayLike,
    *,
    masses: Masses = "null",
    null_cost: float = 1.0,
) -> FloatArray:
    """Exact EMDs (n,) of weights (n, k) and (n, l) under costs (n, k, l), one after the other on one thread.

    Values and errors as of `emd_from_costs` row by row.
    """
    check_masses(masses)
    if not (np.isfinite(null_cost) and null_cost >= 0):
        raise SettingsError(f"emd: expected a finite null_cost >= 0, got {null_cost}")
    p = _non_negative("weights_p", weights_p, 2)
    q = _non_negative("weights_q", weights_q, 2)
    c = _non_negative("costs", costs, 3)
    if len(p) != len(q) or c.shape != (len(p), p.shape[1], q.shape[1]):
        raise DataError(
            f"emd: expected costs {(len(p), p.shape[1], q.shape[1])} for these weights, got {c.shape}"
        )
    mass_p, mass_q = p.sum(axis=1), q.sum(axis=1)
    if not (np.isfinite(mass_p).all() and np.isfinite(mass_q).all()):
        raise DataError("emd: the total weight overflows; scale the weights down")
    if masses != "null":
        refuse_empty(mass_p, mass_q, masses)
    if masses == "balanced":
        p, q = p / mass_p[:, None], q / mass_q[:, None]
    from depthprint._kernels.pairs import solve_many

    works: FloatArray
    works, status = solve_many(p, q, c, null_cost if masses == "null" else 0.0, masses == "balanced")
    check_status(status)
    if masses == "rubner":
        works /= np.minimum(mass_p, mass_q)
    return works


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
    """Exact distances (n, m) of signatures ``a`` to signatures ``b``, or among themselves when None.

    ``form`` None gives the EMD, else the normalised distance of that form (see `depthprint.ncd`); there an
    empty signature has complexity 0 and distance 1 to any other. ``shifts`` (S, position_dims): the least
    over these offsets of a's positions. ``below``: larger distances are returned as inf, most of them unsolved
    and many not even looked at. Parallel over pairs; the result does not depend on the number of threads.

    Raises FingerprintError, DataError (dimensions; an empty signature where ``masses`` is not `null` and
    ``form`` is None), SettingsError, ConvergenceError.
    """
    ground = GroundDistance() if ground is None else ground
    check_masses(masses)
    check_form(form)
    other = a if b is None else b
    check_alike(a.fingerprint, a.points.shape[2], other.fingerprint, other.points.shape[2], ground)
    offsets = shift_table(shifts, ground)
    if below is not None and np.isnan(below):
        raise SettingsError("difference_matrix: below must be a number, got nan")
    from depthprint._kernels.pairs import difference_run, difference_tasks
    from depthprint._matrix_tasks import BelowBound, row_tasks

    left = side_arrays(a, masses, ground, right=False)
    right = side_arrays(other, masses, ground, right=True)
    if form is None and masses != "null":
        refuse_empty(left.masses, right.masses, masses)
    symmetric = b is None and closed_under_negation(offsets)
    rules = pair_rules(masses, form, ground)
    limit = np.inf if below is None else float(below)
    out = np.empty((len(a), len(other)))
    total = len(a) * (len(a) + 1) // 2 if symmetric else out.size
    step = max(1, _CELLS_PER_TASK // (left.weights.shape[1] * right.weights.shape[1]))
    may_be_below = BelowBound(left, right, ground, rules, limit)
    tasks: list[npt.NDArray[np.int64]] = []
    pending = done = 0
    for i in range(len(a)):
        first = i if symmetric else 0
        out[i, first:] = np.inf
        tasks.append(row_tasks(i, may_be_below.columns(i, first), step))
        pending += len(other) - first
        if pending >= _PAIRS_PER_CALL or i == len(a) - 1:
            solve = difference_run if out.size <= _PAIRS_WORTH_THREADS else difference_tasks
            status = solve(left, right, np.concatenate(tasks), offsets, limit, rules, out)
            check_status(np.atleast_1d(status))
            done, pending, tasks = done + pending, 0, []
            if progress is not None:
                progress(done, total)
    if symmetric:
        for i in range(len(a)):
            out[i + 1 :, i] = out[i, i + 1 :]
    return out


def _non_negative(name: str, values: npt.ArrayLike, ndim: int) -> FloatArray:
    array = np.array(values, dtype=np.float64, order="C")
    if array.ndim != ndim:
        raise DataError(f"emd: expected {name} of {ndim} dimensions, got shape {array.shape}")
    if not (np.isfinite(array).all() and (array >= 0).all()):
        raise DataError(f"emd: {name} must be finite and >= 0")
    return array
