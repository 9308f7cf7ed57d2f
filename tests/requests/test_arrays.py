"""Arrays of other libraries: which descriptors they are, or weights of which detector."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import io
from skimage import data, feature

import nablahog
from nablahog import presets
from nablahog.compat.opencv import HOGDescriptor
from nablahog.requests.advice import advise
from nablahog.requests.arrays import fit_array, identify, read_stored, suggest
from nablahog.requests.inversion import GlyphRequest
from nablahog.requests.options import words
from nablahog.requests.templates import read_templates

from ..cli.common import CHELSEA

SPEC = presets.vlfeat()


@pytest.fixture(scope="module")
def array() -> NDArray[np.float32]:
    """What VLFeat returns, (31, 6, 8)."""
    image = torch.from_numpy(CHELSEA[:48, :64].copy()).permute(2, 0, 1)[None]
    return nablahog.hog(image, SPEC, layout="native")[0].numpy()


@pytest.mark.parametrize(
    ("ending", "kind"),
    [("npy", ">f4"), ("npz", "float64"), ("mat", "float64"), ("npy-batch", "float16"), ("npy-ours", "float64")],
)
def test_files(tmp_path: Path, array: NDArray[np.float32], kind: str, ending: str) -> None:
    values, path = array.astype(kind), tmp_path / "d.dat"
    if ending == "mat":
        io.savemat(path, {"hog": values, "sbin": 8.0, "name": "cat"}, appendmat=False)
    else:
        with open(path, "wb") as file:
            if ending == "npz":
                np.savez(file, hog=values, sbin=8.0, name="cat", objects=np.array([{}], dtype=object))
            else:
                np.save(file, {"npy-batch": values[None], "npy-ours": values.transpose(1, 2, 0)}.get(ending, values))
    result = read_stored(str(path), GlyphRequest(preset="vlfeat"))[0].stored
    assert (result.spec, result.image_size) == (SPEC, (48, 64))
    assert torch.equal(result.descriptor.double(), torch.from_numpy(values.astype(np.float64)).permute(1, 2, 0))


@pytest.mark.slow
@pytest.mark.parametrize("asked", [{}, {"preset": "opencv"}, {"preset": "opencv", "image_size": (128, 64)}])
def test_windows_in_one_row_are_rows(tmp_path: Path, asked: dict[str, Any]) -> None:
    cv2 = pytest.importorskip("cv2")
    image = np.ascontiguousarray(data.chelsea()[:128, :80, ::-1])
    vector = cv2.HOGDescriptor().compute(image)
    np.save(tmp_path / "v.npy", vector)
    windows = read_stored(str(tmp_path / "v.npy"), GlyphRequest(**asked))
    assert [each.request.row for each in windows] == [0, 1, 2]
    for row, window in enumerate(windows):
        [chosen] = read_stored(str(tmp_path / "v.npy"), GlyphRequest(**asked, row=row))
        assert torch.equal(chosen.stored.descriptor, window.stored.descriptor)
        stored = nablahog.to_layout(window.stored.descriptor[None], presets.opencv())[0]
        assert np.array_equal(stored.numpy(), vector.reshape(3, -1)[row])
    with pytest.raises(ValueError, match="no row 3: the array has 3 rows"):
        read_stored(str(tmp_path / "v.npy"), GlyphRequest(**asked, row=3))


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(-1,), (1, -1), (-1, 1)])
def test_a_single_row_may_be_chosen(tmp_path: Path, array: NDArray[np.float32], shape: tuple[int, ...]) -> None:
    np.save(tmp_path / "v.npy", array.reshape(shape))
    asked = GlyphRequest(preset="vlfeat", image_size=(48, 64))
    [expected] = read_stored(str(tmp_path / "v.npy"), asked)
    [chosen] = read_stored(str(tmp_path / "v.npy"), replace(asked, row=0))
    assert torch.equal(chosen.stored.descriptor, expected.stored.descriptor)
    with pytest.raises(ValueError, match="no row 1: the array has 1 row"):
        read_stored(str(tmp_path / "v.npy"), replace(asked, row=1))


def test_of_what_has_rows_and_columns_no_row_is_chosen(tmp_path: Path, array: NDArray[np.float32]) -> None:
    np.save(tmp_path / "v.npy", array)
    with pytest.raises(ValueError, match="leave out the row"):
        read_stored(str(tmp_path / "v.npy"), GlyphRequest(preset="vlfeat", row=0))


def test_windows_of_noise_are_rows_where_their_size_is_said() -> None:
    """No check decides on noise: three windows of 128x64, or of 80x64."""
    noise = np.random.default_rng(0).random(3 * 3780)
    for said in ({"image_size": (128, 64)}, {"settings": {"win_size": "64x128"}}):
        assert identify(noise, GlyphRequest(preset="opencv", **said))[1].shape == (3780,)
    assert identify(noise[: 3 * 2268], GlyphRequest(preset="opencv", image_size=(80, 64)))[1].shape == (2268,)
    with pytest.raises(ValueError, match="got"):
        identify(noise, GlyphRequest(preset="opencv"))
    with pytest.raises(ValueError, match="got"):
        identify(noise[1:], GlyphRequest(preset="opencv", image_size=(128, 64)))


def asked_for(array: NDArray[Any], **request: Any) -> str:
    """The options by which an array is read."""
    return " ".join(words(identify(array, GlyphRequest(**request))[0], GlyphRequest))


@pytest.mark.slow
def test_what_was_set_is_kept() -> None:
    """Cells of 4 pixels: an image of 32x32, not of 64x64."""
    image = data.camera()[100:132, 200:232]
    vector = feature.hog(image, pixels_per_cell=(4, 4), cells_per_block=(2, 2))
    settings = {"pixels_per_cell": "4x4"}
    expected = "--preset skimage --set pixels_per_cell=4x4 --set cells_per_block=2x2 --image-size 32x32"
    assert asked_for(vector, preset="skimage", settings=settings) == expected
    assert asked_for(vector) == "--preset skimage --set cells_per_block=2x2 --image-size 64x64"
    [first, *_] = suggest(np.random.default_rng(0).random(1764), GlyphRequest(preset="skimage", settings=settings))
    assert first.request.settings["pixels_per_cell"] == "4x4"


@pytest.mark.parametrize(
    ("size", "expected"), [((128, 64), "--preset opencv"), ((96, 64), "--preset opencv --set win_size=64x96")]
)
def test_the_usual_window_need_not_be_said(size: tuple[int, int], expected: str) -> None:
    image = data.astronaut()[40 : 40 + size[0], 190 : 190 + size[1]]
    vector = nablahog.hog(image, presets.opencv(size[::-1]), layout="native")
    assert asked_for(np.asarray(vector).ravel()) == expected


def advice(array: NDArray[Any], **request: Any) -> str:
    """The options that are advised in place of others."""
    found = advise(array, GlyphRequest(**request))
    return "" if found is None else " ".join(words(found.request, GlyphRequest))


@pytest.mark.slow
def test_what_to_ask_for_instead() -> None:
    """Of a wrong size, exchanged sides, other cells and another preset, as far as the numbers decide."""
    gray, colour = data.camera()[:128, 190:318], data.astronaut()[:128, 190:350]
    square = nablahog.hog(colour[:, :128], "uoctti", layout="native").ravel()
    wide = nablahog.hog(colour, "uoctti", layout="native").ravel()
    cells = feature.hog(gray, pixels_per_cell=(16, 16))
    assert advice(square, image_size=(128, 160)) == "--preset uoctti --image-size 128x128"
    assert advice(square, preset="uoctti", image_size=(128, 160)) == "--preset uoctti --image-size 128x128"
    assert advice(wide, image_size=(160, 128)) == "--preset uoctti --image-size 128x160"
    assert advice(cells, image_size=(128, 128)) == "--preset skimage --set pixels_per_cell=16x16 --image-size 128x128"
    assert advice(square, preset="opencv") == "--preset uoctti --image-size 128x128"
    assert advice(np.random.default_rng(0).random(1001), image_size=(64, 64)) == ""


def test_sides_that_seem_exchanged_are_remarked_on(tmp_path: Path) -> None:
    """OpenCV writes 64x128 of a window that is upright."""
    vector = nablahog.hog(data.astronaut()[40:168, 190:254], "opencv", layout="native")
    np.save(tmp_path / "v.npy", vector)
    for size, is_remarked in (((64, 128), True), ((128, 64), False)):
        [found] = read_stored(str(tmp_path / "v.npy"), GlyphRequest(preset="opencv", image_size=size))
        assert found.request.image_size == size
        assert (found.advice is not None) == is_remarked


@pytest.mark.parametrize("factor", [255, 3, 0])
def test_numbers_that_contradict_the_preset_are_remarked_on(tmp_path: Path, factor: float) -> None:
    """Scaled ones, or all equal; the request is carried out all the same."""
    vector = nablahog.hog(data.astronaut()[40:168, 190:254], "opencv", layout="native")
    np.save(tmp_path / "v.npy", vector * factor if factor else np.full(3780, 0.1))
    [found] = read_stored(str(tmp_path / "v.npy"), GlyphRequest(preset="opencv", image_size=(128, 64)))
    assert found.advice is not None
    assert found.advice.request is None
    assert (f"divided by {factor} they may be opencv()" if factor else "all equal") in found.advice.remark


@pytest.mark.slow
def test_all_suggestions_work_as_they_stand() -> None:
    for shape in ((5, 4, 32), (31, 4, 5), (324,), (16, 108)):
        array = np.random.default_rng(0).random(shape)
        suggestions = suggest(array, GlyphRequest())
        assert 0 < len(suggestions) <= 6
        for suggestion in suggestions:
            identify(array, suggestion.request)
    for nothing in ((0,), (5, 0, 31), (100_003,)):
        assert suggest(np.zeros(nothing), GlyphRequest()) == []


@pytest.mark.parametrize(("negative", "is_detector"), [(378, False), (379, True)])
def test_a_row_of_which_more_than_a_tenth_is_negative_is_of_a_detector(negative: int, is_detector: bool) -> None:
    row = np.random.default_rng(0).random(3780)
    row[:negative] *= -1
    assert suggest(row, GlyphRequest(preset="opencv"))[0].is_detector == is_detector
    assert 0 < len(suggest(row, GlyphRequest())) <= 6


@pytest.mark.parametrize(
    ("shape", "asked", "message"),
    [
        ((7936,), {"preset": "vlfeat"}, "do not say how large their image was"),
        (
            (3780,),
            {"preset": "opencv", "settings": {"win_size": "64x128"}, "image_size": (64, 64)},
            "contradict each other",
        ),
    ],
)
def test_what_is_refused(shape: tuple[int, ...], asked: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_array(shape, GlyphRequest(**asked))


@pytest.mark.parametrize(("length", "size"), [(3780, (128, 64)), (1980, (96, 48))])
def test_the_windows_of_opencvs_people_detectors(tmp_path: Path, length: int, size: tuple[int, int]) -> None:
    weights = np.random.default_rng(0).standard_normal(length + 1).astype(np.float32)
    for name, vector in (("plain", weights[:-1]), ("biased", weights), ("row", weights[np.newaxis])):
        np.save(tmp_path / f"{name}.npy", vector)
        [template] = read_templates(str(tmp_path / f"{name}.npy"), GlyphRequest())
        assert (template.spec.name, template.image_size) == ("opencv", size)
        native = nablahog.to_layout(template.descriptor[None], presets.opencv(size[::-1]))
        assert torch.equal(native.flatten(), torch.from_numpy(weights[:-1]))
    np.save(tmp_path / "longer.npy", np.append(weights, 0))
    with pytest.raises(ValueError, match="preset"):
        read_templates(str(tmp_path / "longer.npy"), GlyphRequest())


@pytest.mark.slow
def test_a_descriptor_that_opencv_saved(tmp_path: Path) -> None:
    hog, path = HOGDescriptor(), str(tmp_path / "hog.yml")
    hog.save(path)
    with pytest.raises(ValueError, match=r"hog\.yml: expected a HOGDescriptor with the coefficients of its detector"):
        read_templates(path, GlyphRequest())
    weights = np.linspace(-1, 1, 3781, dtype=np.float32)
    hog.setSVMDetector(weights)
    hog.save(path)
    [template] = read_templates(path, GlyphRequest())
    assert (template.spec, template.image_size) == (presets.opencv(), (128, 64))
    native = nablahog.to_layout(template.descriptor[None], presets.opencv())
    torch.testing.assert_close(native.flatten(), torch.from_numpy(weights[:-1]))


def test_settings_that_were_asked_for_stay(array: NDArray[np.float32]) -> None:
    """Also those that are the preset's own."""
    request = GlyphRequest(settings={"cell_size": "8"})
    found, _, _ = identify(array, request)
    assert (found.preset, found.settings) == ("vlfeat", {"cell_size": "8"})
