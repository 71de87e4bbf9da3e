"""The encoder: presets, fitting, determinism, the model file."""

import numpy as np
import pytest

from depthprint.encoder import Encoder
from depthprint.errors import DataError, ModelError, SettingsError
from depthprint.presets import PRESETS, preset_settings
from depthprint.settings import EncoderSettings
from depthprint.sparse_coding import sparse_code
from synthetic import boxes, crop, scan

IMAGES = {
    "object": [crop(i) for i in range(12)],
    "laser": [scan(i) for i in range(12)],
}
DEFAULT = [boxes(i) for i in range(12)]


def small(preset: str) -> EncoderSettings:
    """The preset with few atoms, so that a dozen images suffice."""
    settings = preset_settings(preset)
    n = 8 if preset == "literal" else 32
    streams = tuple(
        s.model_copy(update={"n_atoms": n, "n_nonzero": min(4, s.n_nonzero)}) for s in settings.streams
    )
    return settings.model_copy(update={"streams": streams})


def fitted(preset: str) -> tuple[Encoder, list]:
    images = IMAGES.get(preset, DEFAULT)
    return Encoder(small(preset)).fit(images), images


@pytest.mark.parametrize("preset", PRESETS)
def test_an_image_is_nearest_to_itself(preset):
    encoder, images = fitted(preset)
    index = encoder.make_index()
    for image in images:
        index.add(encoder.describe(image).signatures)
    for number, image in enumerate(images):
        (place, distance, _), *_ = index.query(encoder.describe(image).signatures, k=2)
        assert place == number
        assert distance == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("preset", ["street", "handheld"])
def test_the_same_seed_gives_the_same_model(preset):
    assert fitted(preset)[0].fingerprint == fitted(preset)[0].fingerprint


@pytest.mark.parametrize("preset", ["street", "object", "literal"])
def test_a_saved_model_loads_and_gives_the_same_signatures(preset, tmp_path):
    encoder, images = fitted(preset)
    loaded = Encoder.load(encoder.save(tmp_path / "model.npz"))
    assert loaded.fingerprint == encoder.fingerprint
    for a, b in zip(
        loaded.describe(images[0]).signatures, encoder.describe(images[0]).signatures, strict=True
    ):
        assert a.fingerprint == b.fingerprint
        assert np.array_equal(a.points, b.points)
        assert np.array_equal(a.weights, b.weights)


def test_a_street_model_finds_a_shifted_view_and_says_by_how_much():
    encoder, images = fitted("street")
    index = encoder.make_index()
    for image in images:
        index.add(encoder.describe(image).signatures)
    pixels_per_sector = 128 / 24
    moved = boxes(5, shift=int(2 * pixels_per_sector))
    (place, _, shift), *_ = index.query(encoder.describe(moved).signatures)
    assert place == 5
    assert encoder.shift_sectors()[shift] != 0


@pytest.mark.parametrize("keep", [0.0, 0.5, 0.99])
def test_a_model_file_cut_short_is_an_error_that_names_it(keep, tmp_path):
    path = fitted("street")[0].save(tmp_path / "model.npz")
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * keep)])
    with pytest.raises(ModelError, match=r"model\.npz"):
        Encoder.load(path)


def test_a_model_of_another_version_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr("depthprint.encoder_file.FORMAT_VERSION", 99)
    path = fitted("street")[0].save(tmp_path / "model.npz")
    monkeypatch.undo()
    with pytest.raises(ModelError, match=r"version 1, got .* version 99"):
        Encoder.load(path)


def test_an_encoder_that_is_not_fitted_says_so():
    with pytest.raises(ModelError, match="not fitted"):
        Encoder.from_preset("street").describe(boxes(0))


def test_training_on_one_image_is_an_error():
    with pytest.raises(DataError, match="at least 2"):
        Encoder.from_preset("street").fit([boxes(0)])


def test_too_few_patches_for_the_dictionary_is_an_error_that_counts_them():
    with pytest.raises(DataError, match="256 atoms"):
        Encoder.from_preset("literal").fit(DEFAULT)


def test_unknown_settings_are_refused_by_name():
    with pytest.raises(SettingsError, match="colour"):
        EncoderSettings.parse({"name": "x", "streams": (), "colour": 1})


def test_unknown_preset_lists_the_known_ones():
    with pytest.raises(SettingsError, match="handheld"):
        preset_settings("submarine")


def test_a_handheld_model_forgives_a_small_shift_of_the_view():
    encoder, images = fitted("handheld")
    still = Encoder(encoder.settings.model_copy(update={"view_shift_steps": (0, 0)}), encoder.streams)
    moved = boxes(5, shift=10)

    def distance(model: Encoder) -> float:
        index = model.make_index()
        index.add(encoder.describe(images[5]).signatures)
        return float(index.distances(encoder.describe(moved).signatures)[0])

    assert distance(encoder) < distance(still)
    assert len(encoder.shift_offsets()) == 9
    assert not encoder.shift_offsets()[0].any()


def test_whole_image_atoms_code_a_planar_scan_as_a_repeated_row():
    encoder, _ = fitted("literal")
    view, _, model = encoder.codes(scan(3))
    assert (view.channels == view.channels[:, :1]).all()
    assert len(model.row(0)[0]) > 0


@pytest.mark.parametrize("preset", ["street", "handheld"])
def test_pixels_for_atoms_leave_patches_as_they_are(preset):
    settings = small(preset)
    streams = tuple(s.model_copy(update={"dictionary": "pixels"}) for s in settings.streams)
    encoder = Encoder(settings.model_copy(update={"streams": streams})).fit(DEFAULT)
    _, patches, model = encoder.codes(DEFAULT[3])
    assert np.array_equal(model.to_dense(), patches.vectors)
    exact = patches.vectors.astype(np.float64)
    pursued = sparse_code(exact, encoder.streams[0].dictionary, n_nonzero=None)
    assert np.allclose(pursued.to_dense(), exact, atol=1e-6)
