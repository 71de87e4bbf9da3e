from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthprint.complexity import COMPRESSORS, emd_complexity
from depthprint.emd import difference_matrix, emd
from depthprint.errors import DataError, SettingsError
from depthprint.ncd import FORMS, compression_distance, information, joint, ncd, steinhaus
from depthprint.signature import GroundDistance, Signature, SignatureBatch

floats = st.floats(0, 1e6, allow_subnormal=False)


def test_eq_8() -> None:
    assert ncd(10, 20, 25) == 0.75
    np.testing.assert_array_equal(ncd([4.0, 0.0], [8.0, 0.0], [8.0, 0.0]), [0.5, 0.0])


def test_eq_8_is_not_clipped_for_poor_compressors() -> None:
    assert ncd(10, 10, 25) == 1.5


def test_forms_by_hand() -> None:
    assert joint(2.0, 4.0, 3.0) == 3 / 8
    assert information(2.0, 4.0, 3.0) == 0.5
    assert steinhaus(2.0, 4.0, 3.0) == 4 / 9


def test_joint_form_is_eq_8_with_the_joint_complexity() -> None:
    e, x, y = 2.0, 4.0, 3.0
    assert joint(e, x, y) == ncd(x, y, (x + y + e) / 2)


@pytest.mark.parametrize("form", FORMS)
def test_forms_broadcast_and_give_0_for_two_empty_and_1_for_one(form: str) -> None:
    k = np.array([0.0, 2.0])
    e = np.abs(k[:, None] - k[None])
    np.testing.assert_array_equal(FORMS[form](e, k[:, None], k[None]), [[0, 1], [1, 0]])


@given(x=floats, y=floats, share=st.floats(0, 1))
def test_joint_and_steinhaus_stay_in_0_1_and_information_in_0_2(x: float, y: float, share: float) -> None:
    e = abs(x - y) + share * (x + y - abs(x - y))
    assert 0 <= joint(e, x, y) <= 1
    assert 0 <= steinhaus(e, x, y) <= 1
    assert 0 <= information(e, x, y) <= 2


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    sizes=st.lists(st.integers(0, 6), min_size=2, max_size=4),
    masses=st.sampled_from(["null", "rubner", "balanced"]),
    cap=st.sampled_from([0.5, 1.0, 1.5, 2.0]),
)
def test_ncd_of_signatures_is_in_0_1_symmetric_and_0_on_itself(
    seed: int, sizes: list[int], masses: str, cap: float
) -> None:
    rng = np.random.default_rng(seed)
    batch = SignatureBatch.stack([Signature(rng.random(k), rng.normal(size=(k, 2))) for k in sizes])
    for form in FORMS:
        a = difference_matrix(batch, masses=masses, ground=GroundDistance(cap=cap), form=form)
        b = difference_matrix(batch, batch, masses=masses, ground=GroundDistance(cap=cap), form=form)
        upper = 2 if form == "information" and cap > 1 else 1
        assert (a >= 0).all()
        assert (a <= upper * (1 + 1e-12)).all()
        assert (np.diag(a) == 0).all() or masses == "rubner"
        np.testing.assert_allclose(b, b.T, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(np.diag(a), 0, atol=1e-15)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_steinhaus_keeps_the_triangle_inequality(seed: int) -> None:
    rng = np.random.default_rng(seed)
    batch = SignatureBatch.stack([Signature(rng.random(k), rng.normal(size=(k, 2))) for k in (2, 5, 3, 4)])
    d = difference_matrix(batch, form="steinhaus")
    assert (d[:, None, :] <= d[:, :, None] + d[None, :, :] + 1e-12).all()


def test_forms_take_emd_and_complexity_of_one_ground_distance() -> None:
    rng = np.random.default_rng(0)
    x, y = (Signature(rng.random(6), rng.normal(size=(6, 3))) for _ in range(2))
    ground = GroundDistance(null_cost=2.0, cap=4.0)
    value = joint(emd(x, y, ground=ground).value, emd_complexity(x, ground), emd_complexity(y, ground))
    assert 0 < value <= 1
    with pytest.raises(DataError, match=r"exceeds K\(X\) \+ K\(Y\)"):
        joint(3.0, 1.0, 1.0)
    with pytest.raises(DataError, match="k_x"):
        joint(1.0, np.nan, 1.0)


@pytest.mark.parametrize("compressor", COMPRESSORS)
@pytest.mark.parametrize("order", ["min", "mean"])
def test_compression_distance_is_symmetric_and_orders_texts(compressor: str, order: str) -> None:
    if compressor == "zstd":
        pytest.importorskip("zstandard")
    rng = np.random.default_rng(1)
    x, y = rng.bytes(3000), rng.bytes(2000)
    near = x[:1500] + rng.bytes(1500)
    assert compression_distance(x, y, compressor, order=order) == compression_distance(
        y, x, compressor, order=order
    )
    same = compression_distance(x, x, compressor, order=order)
    assert same < compression_distance(x, near, compressor, order=order)
    assert compression_distance(x, near, compressor, order=order) < compression_distance(
        x, y, compressor, order=order
    )
    assert compression_distance(b"", b"", compressor) == 0
    assert compression_distance(x, b"", compressor) == 1


def test_unknown_choices_are_refused() -> None:
    with pytest.raises(SettingsError, match="order"):
        compression_distance(b"a", b"b", order="max")  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="compressor"):
        compression_distance(b"a", b"b", "zip")
