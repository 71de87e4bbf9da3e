"""Dictionaries: what they accept, their fingerprints, and files that are whole or refused."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest

from depthprint.dictionary import Dictionary
from depthprint.errors import DataError, ModelError


def make(seed=0, **options):
    atoms = np.random.default_rng(seed).standard_normal((12, 7))
    return Dictionary(atoms / np.linalg.norm(atoms, axis=1, keepdims=True), **options)


def test_atoms_are_kept_read_only_and_apart_from_the_callers():
    given = np.eye(3)
    dictionary = Dictionary(given)
    given[0, 0] = 5
    assert dictionary.atoms[0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        dictionary.atoms[0, 0] = 2
    with pytest.raises(TypeError):
        dictionary.settings["n"] = 1


@pytest.mark.parametrize(
    ("atoms", "message"),
    [
        (np.ones((2, 3)), "row 0 has norm"),
        (np.full((2, 3), np.nan), "row 0 has norm nan"),
        (np.ones(3), r"\(K, d\)"),
        (np.empty((0, 3)), r"\(K, d\)"),
    ],
)
def test_wrong_atoms_are_refused(atoms, message):
    with pytest.raises(DataError, match=message):
        Dictionary(atoms)


def test_settings_that_are_not_json_are_refused():
    with pytest.raises(DataError, match="JSON"):
        make(settings={"x": np.nan})


def test_fingerprint_changes_with_every_part():
    base = make()
    atoms = base.atoms.copy()
    atoms[3, 2] = np.nextafter(atoms[3, 2], 1)
    others = [
        Dictionary(atoms),
        make(kind="parametric"),
        make(settings={"lambda_": 0.5}),
        make(seed=1),
        Dictionary(base.atoms[::-1]),
        Dictionary(base.atoms, seed=3),
    ]
    prints = {d.fingerprint for d in [base, *others]}
    assert len(prints) == len(others) + 1
    assert base == make()
    assert hash(base) == hash(make())
    assert all(len(p) == 16 for p in prints)


def test_file_gives_back_the_same_bits(tmp_path):
    dictionary = make(kind="learned-l1", settings={"lambda_": 0.1, "shape": [1, 7]})
    dictionary.save(tmp_path / "atoms.npz")
    loaded = Dictionary.load(tmp_path / "atoms.npz")
    assert loaded == dictionary
    assert loaded.atoms.tobytes() == dictionary.atoms.tobytes()
    assert (loaded.kind, dict(loaded.settings), loaded.seed) == (
        dictionary.kind,
        dict(dictionary.settings),
        dictionary.seed,
    )
    assert [p.name for p in tmp_path.iterdir()] == ["atoms.npz"]


def test_a_file_cut_anywhere_is_refused_and_named(tmp_path):
    path = tmp_path / "atoms.npz"
    make().save(path)
    whole = path.read_bytes()
    for length in [*range(0, len(whole), 97), len(whole) // 2, len(whole) - 1]:
        path.write_bytes(whole[:length])
        with pytest.raises(ModelError, match=r"atoms\.npz: expected"):
            Dictionary.load(path)


def test_changed_bytes_never_load_as_something_else(tmp_path):
    path = tmp_path / "atoms.npz"
    original = make()
    original.save(path)
    whole = path.read_bytes()
    for place in range(0, len(whole), 41):
        damaged = bytearray(whole)
        damaged[place] ^= 0x5A
        path.write_bytes(damaged)
        try:
            assert Dictionary.load(path) == original
        except ModelError:
            continue


def rewrite(path, **changes):
    with np.load(path) as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays["header"]))
    header.update({k: v for k, v in changes.items() if k in header})
    arrays["header"] = np.array(json.dumps(header, sort_keys=True))
    if "atoms" in changes:
        arrays["atoms"] = changes["atoms"]
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 2}, "version 1, got .* version 2"),
        ({"format": "something"}, "'something'"),
        ({"settings": {"lambda_": 9.0}}, "altered"),
        ({"atoms": np.eye(7)}, "altered"),
        ({"atoms": np.ones((2, 7))}, "norm"),
    ],
)
def test_another_version_or_content_is_refused(tmp_path, changes, message):
    path = tmp_path / "atoms.npz"
    make().save(path)
    rewrite(path, **changes)
    with pytest.raises(ModelError, match=message):
        Dictionary.load(path)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(ModelError, match="missing"):
        Dictionary.load(tmp_path / "missing.npz")
    np.savez(tmp_path / "other.npz", x=np.ones(3))
    with pytest.raises(ModelError, match="header"):
        Dictionary.load(tmp_path / "other.npz")
    np.save(tmp_path / "array.npy", np.ones(3))
    with pytest.raises(ModelError, match="expected a dictionary file"):
        Dictionary.load(tmp_path / "array.npy")
    np.savez(tmp_path / "objects.npz", header=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ModelError, match="expected a dictionary file"):
        Dictionary.load(tmp_path / "objects.npz")
    with pytest.raises(ModelError):
        Dictionary.load(tmp_path)


def test_travels_between_processes():
    assert pickle.loads(pickle.dumps(make())) == make()


def test_gram_in_both_precisions():
    dictionary = make()
    np.testing.assert_allclose(
        dictionary.gram_as(np.float64), dictionary.atoms @ dictionary.atoms.T, atol=1e-15
    )
    assert dictionary.gram_as(np.float32).dtype == np.float32
    assert dictionary.atoms_as(np.float32).dtype == np.float32
