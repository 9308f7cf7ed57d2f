"""Descriptors of unknown origin, made by other programs where there is one: decided and right, or undecided."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageOps
from skimage import data, feature

import nablahog
from nablahog import presets, which_hog
from nablahog.invert.candidates import Candidate
from nablahog.invert.orders import _difference_of_neighbours, check_layout
from nablahog.invert.which import MOST_NAMED, WhichHOG
from nablahog.io.descriptor_file import FittedLayout

Array = NDArray[np.floating]
COLOUR = data.astronaut()[40:168, 190:254]  # 128x64
GRAY = data.camera()[100:228, 200:264]
SQUARES = ("astronaut", "camera", "coffee", "chelsea")
xslow = partial(pytest.param, marks=pytest.mark.xslow)


def photograph(name: str = "astronaut", width: int = 64, height: int = 128) -> NDArray[np.uint8]:
    return np.asarray(Image.fromarray(getattr(data, name)()).convert("L").resize((width, height)))


def opencv(image: Any = COLOUR[..., ::-1], stride: int = 8) -> Array:
    """OpenCV's own descriptor of an image, by default of its default window."""
    cv2 = pytest.importorskip("cv2")
    descriptor = cv2.HOGDescriptor(image.shape[1::-1], (16, 16), (stride, stride), (8, 8), 9)
    vector: Array = descriptor.compute(np.ascontiguousarray(image)).ravel()
    return vector


def opencv_windows(width: int, height: int, win_size: tuple[int, int] = (64, 128), stride: int = 8) -> Any:
    """OpenCV's own descriptors of all windows of an image, in one row."""
    cv2 = pytest.importorskip("cv2")
    image = np.ascontiguousarray(data.chelsea()[:height, :width, ::-1])
    return cv2.HOGDescriptor(win_size, (16, 16), (8, 8), (8, 8), 9).compute(image, winStride=(stride, stride))


def skimage(image: Any = GRAY, **arguments: Any) -> Array:
    vector: Array = feature.hog(image, **arguments)
    return vector


def blocks(name: str = "astronaut", width: int = 64, height: int = 128, norm: str = "L2-Hys") -> Array:
    """Scikit-image's own descriptor with blocks of 2x2 cells."""
    return skimage(photograph(name, width, height), cells_per_block=(2, 2), block_norm=norm)


def in_one_row(count: int) -> Array:
    return np.concatenate([blocks(name, 64, 64) for name in SQUARES[:count]])


def ours(name: str, size: tuple[int, int] | None = None) -> Array:
    """By default of one of the images above, or of a photograph of so many pixels in width and height."""
    image = GRAY if getattr(presets, name)().colour == "gray" else COLOUR
    image = image if size is None else np.dstack([photograph("astronaut", *size)] * 3)
    return nablahog.hog(image, name, layout="native")


RECOGNISED = {
    "OpenCV": (opencv, "opencv", {}),
    "scikit-image": (skimage, "skimage", {}),
    "scikit-image, 2x2": (lambda: skimage(cells_per_block=(2, 2)), "skimage", {"cells_per_block": (2, 2)}),
    "scikit-image, L1": (lambda: skimage(block_norm="L1"), "skimage", {"block_norm": "L1"}),
    "six decimals": (lambda: blocks().round(6), "skimage", {"cells_per_block": (2, 2)}),
    "seven decimals of L1": (
        lambda: blocks(norm="L1").round(7),
        "skimage",
        {"cells_per_block": (2, 2), "block_norm": "L1"},
    ),
    "six decimals of OpenCV": (lambda: opencv(photograph()).round(6), "opencv", {}),
    "five decimals of VLFeat": (lambda: ours("vlfeat", (64, 128)).ravel().round(5), "vlfeat", {}),
    "float32": (lambda: blocks().astype(np.float32), "skimage", {"cells_per_block": (2, 2)}),
}


@pytest.mark.parametrize("name", RECOGNISED)
def test_a_vector_is_recognised(name: str) -> None:
    make, preset, parameters = RECOGNISED[name]
    found = which_hog(make())
    first = found.candidates[0]
    assert found.decided_by
    assert (first.preset, dict(first.parameters), first.image_size) == (preset, parameters, (128, 64))
    assert first.summary.endswith(" of 128x64")


@cache
def recognise(name: str) -> WhichHOG:
    """What is found for the numbers of a preset in a row."""
    return which_hog(ours(name).ravel())


@pytest.mark.parametrize("name", ["dalal_triggs", "vlfeat", "uoctti", "dpm", "dlib", "piotr", "cnn_hog"])
def test_a_vector_of_a_preset_is_recognised(name: str) -> None:
    first = recognise(name).candidates[0]
    assert recognise(name).decided_by
    assert (first.preset, dict(first.parameters), first.image_size) == (name, {}, (128, 64))


@pytest.mark.parametrize("orientations", [6, 8, 9, 12, 18])
def test_usual_numbers_of_orientations_are_recognised(orientations: int) -> None:
    vector = skimage(photograph(), cells_per_block=(2, 2), orientations=orientations)
    found = which_hog(vector, dialects={"skimage": {"cells_per_block": (2, 2)}})
    assert found.decided_by
    assert (found.candidates[0].spec.bins, found.candidates[0].image_size) == (orientations, (128, 64))


def test_sizes_that_the_order_excludes_are_still_named() -> None:
    sizes = {each.image_size for each in recognise("dalal_triggs").candidates if not each.parameters}
    assert {(128, 64), (64, 128)} < sizes


def test_cells_with_nothing_in_common_differ_by_twice_their_variance() -> None:
    cells = np.random.default_rng(0).random((20, 24, 31), dtype=np.float32)
    assert _difference_of_neighbours(which_hog(cells).candidates[0], cells) == pytest.approx(2, abs=0.05)


def test_five_decimals_of_a_small_image_are_recognised() -> None:
    found = which_hog(blocks("coffee", 64, 64).round(5))
    assert found.decided_by
    assert (found.candidates[0].preset, found.candidates[0].image_size) == ("skimage", (64, 64))


MATRIX = in_one_row(3).reshape(3, -1)
ASKED: dict[str, tuple[Callable[[], Array], str]] = {
    "four decimals": (lambda: blocks().round(4), "rounded"),
    "bytes": (lambda: np.uint8(255 * opencv(photograph())), "rounded"),
    "two images in a row": (lambda: in_one_row(2), "reshape(2, 1764)"),
    "four images in a row": (lambda: in_one_row(4), "reshape(4, 1764)"),
    "OpenCV's columns and rows": (lambda: opencv(photograph()).reshape(7, 15, 36), "ravel()"),
    "OpenCV's rows and columns": (lambda: opencv(photograph()).reshape(15, 7, 36), "lines of 15"),
    "axes of MATLAB": (lambda: ours("dlib", (64, 96)).T, "transpose"),
    "a narrow image": (lambda: ours("vlfeat", (200, 32)).ravel(), "narrow"),
    "a narrow image of FHOG": (lambda: ours("piotr", (200, 32)).ravel(), "narrow"),
    "three blocks cut off": (lambda: opencv(photograph("astronaut", 128, 64))[:-108], ""),
    "nine blocks cut off": (lambda: opencv(photograph())[:-324], ""),
    "blocks that share no cells": (lambda: opencv(photograph(), stride=16), ""),
    "places in rows": (lambda: opencv(photograph()).reshape(105, 36), "ravel()"),
    "places of VLFeat in rows": (lambda: ours("vlfeat", (64, 128)).reshape(31, -1).T, "ravel()"),
    "a column of labels": (lambda: np.c_[[-1, 1, -1], MATRIX], "first column"),
    "a column of labels at the end": (lambda: np.c_[MATRIX, [0, 1, 0]], "last"),
    "descriptors in columns": (lambda: MATRIX.T, ".T"),
    "windows without overlap": (
        lambda: np.concatenate([opencv(half) for half in np.hsplit(photograph("gravel", 128), 2)]),
        "",
    ),
    "a factor": (lambda: blocks(norm="L2") * 0.95, ""),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ASKED)
def test_asked_about(name: str) -> None:
    make, words = ASKED[name]
    found = which_hog(make())
    assert not found.decided_by
    assert words in found.remark


@pytest.mark.slow
@pytest.mark.parametrize(("count", "is_tried"), [(16, True), (17, False)])
def test_the_most_descriptors_in_one_row(count: int, is_tried: bool) -> None:
    found = which_hog(np.concatenate([blocks("coffee", 64, 64)] * count))
    assert (f"reshape({count}, 1764)" in found.remark) == is_tried


def test_one_number_is_not_said_to_equal_others() -> None:
    assert which_hog(np.full(1, 0.5)).remark == ""
    assert "equal" in which_hog(np.full(2, 0.5)).remark


def test_of_rounded_numbers_the_shape_tells() -> None:
    found = which_hog(blocks().round(4))
    assert "skimage" in {candidate.preset for candidate in found.candidates}


ASSUMED: dict[str, tuple[Callable[[], Array], str]] = {
    "reversed OpenCV": (lambda: opencv(photograph())[::-1], "reverse"),
    "reversed scikit-image": (lambda: blocks()[::-1], "reverse"),
    "VLFeat with axes of NumPy": (lambda: np.moveaxis(ours("vlfeat", (64, 128)), 0, 2), "vlfeat"),
    "a stride of 4": (lambda: opencv(photograph(), stride=4), "block_stride"),
}


@pytest.mark.parametrize("name", ASSUMED)
def test_what_may_be_wrong_is_assumed(name: str) -> None:
    make, words = ASSUMED[name]
    found = which_hog(make())
    assert found.decided_by
    assert words in found.assumed


def test_targets_of_maskfeat_are_recognised() -> None:
    image = data.astronaut()[100:324, 100:324]
    targets = nablahog.hog(image, presets.maskfeat(layout="tokens"), layout="native")
    found = which_hog(targets)
    assert targets.shape == (196, 108)
    assert found.decided_by
    assert found.candidates[0].spec == presets.maskfeat(layout="tokens")
    assert found.candidates[0].image_size == (224, 224)


def test_the_rows_of_a_matrix_are_descriptors() -> None:
    parts = [data.astronaut()[top : top + 96, 190:254] for top in range(0, 200, 20)]
    matrix = np.stack([nablahog.hog(part, presets.opencv(win_size=(64, 96)), layout="native") for part in parts])
    first = which_hog(matrix).candidates[0]
    assert (first.preset, first.count, first.image_size) == ("opencv", len(parts), (96, 64))


def test_the_places_of_an_image_in_rows_are_not_images_of_one_place() -> None:
    assert not which_hog(ours("uoctti").reshape(-1, 31), dialects={"uoctti": {}}).candidates


@pytest.mark.parametrize(("size", "count"), [((72, 128), 2), ((64, 160), 5), ((128, 128), 9), ((192, 192), 153)])
def test_opencv_windows_in_one_row(size: tuple[int, int], count: int) -> None:
    """A vector of 2 windows has as many numbers as one of 128x120 pixels."""
    found = which_hog(opencv_windows(*size))
    first = found.candidates[0]
    assert f"reshape({count}, 3780)" in found.decided_by
    assert (first.preset, dict(first.parameters), first.image_size, first.count) == ("opencv", {}, (128, 64), count)
    assert count != 2 or (128, 120) in {each.image_size for each in found.candidates[1:]}


def test_windows_with_nothing_in_common_are_asked_about() -> None:
    """They look like one image of all their columns."""
    found = which_hog(opencv_windows(192, 256, stride=64))
    assert not found.decided_by
    assert (9, (128, 64)) in [(each.count, each.image_size) for each in found.candidates[: found.likely]]


@pytest.mark.slow
@pytest.mark.parametrize("corner", [(150, 349), (117, 493), (92, 23)])
def test_faint_windows_of_opencv_clip_nothing(corner: tuple[int, int]) -> None:
    """The first ε of L2-Hys is large: of a sky no entry reaches the clip."""
    y, x = corner
    first = which_hog(opencv(data.rocket()[y : y + 128, x : x + 64, ::-1])).candidates[0]
    assert (first.preset, first.image_size) == ("opencv", (128, 64))


@pytest.mark.parametrize("library", ["opencv", "skimage"])
def test_descriptors_of_several_images_in_one_row_are_asked_about(library: str) -> None:
    """Four of 64x64 pixels have as many blocks as one of 64x232."""
    photographs = [getattr(data, name)()[80:144, 80:144] for name in ("astronaut", "coffee", "chelsea", "cat")]
    spec = presets.skimage(cells_per_block=(2, 2), channel_axis=-1) if library == "skimage" else presets.opencv()
    found = which_hog(np.concatenate([nablahog.hog(each, spec, layout="native") for each in photographs]))
    assert not found.decided_by
    assert "descriptors" in found.remark


@pytest.mark.parametrize(
    ("win_size", "size", "count", "stride"),
    [((48, 96), (80, 104), 10, 8), ((64, 64), (64, 96), 5, 8), ((64, 64), (160, 160), 9, 48)],
)
def test_windows_of_another_size(win_size: tuple[int, int], size: tuple[int, int], count: int, stride: int) -> None:
    """Said, or as the distance between equal blocks tells."""
    vector = opencv_windows(*size, win_size, stride)
    for asked in ({}, {"image_size": win_size[::-1]}, {"dialects": {"opencv": {"win_size": win_size}}}):
        found = which_hog(vector, **asked)
        first = found.candidates[0]
        assert found.decided_by
        assert (first.preset, first.image_size, first.count) == ("opencv", win_size[::-1], count)


def test_one_row_of_blocks_has_no_seams() -> None:
    vector = skimage(photograph(height=24))
    first = which_hog(vector).candidates[0]
    assert (first.preset, first.image_size, first.count) == ("skimage", (24, 64), 1)


def test_a_pattern_is_not_taken_for_windows() -> None:
    stripes = np.zeros((120, 128, 3), np.uint8)
    stripes[::16] = stripes[1::16] = 255
    assert which_hog(nablahog.hog(stripes, "opencv", layout="native")).candidates[0].count == 1


@pytest.mark.slow
def test_what_no_check_tells_is_said() -> None:
    vector = feature.hog(COLOUR, channel_axis=-1, transform_sqrt=True)
    found = which_hog(vector)
    for name in ("transform_sqrt", "channel_axis", "pixels_per_cell"):
        assert name in found.assumed
    assert found.assumed in repr(found)
    known = {"skimage": {"channel_axis": -1, "transform_sqrt": True}}
    assert which_hog(vector, (128, 64), dialects=known).assumed.endswith("assumed: this order, not the reverse")
    for words in ("gamma", "block_stride=(8, 8) (on which the size depends)", "not several in a row", "reverse"):
        assert words in which_hog(opencv()).assumed
    assert which_hog(ours("paper")).assumed == ""


@pytest.mark.slow
def test_one_dialect_is_not_decided_against_its_numbers() -> None:
    """Neither where it is the only one to try."""
    for array in (np.random.default_rng(0).random(3780), 3 * opencv(), skimage(cells_per_block=(2, 2))):
        for size in (None, (128, 64)):
            found = which_hog(array, size, dialects={"opencv": {}})
            assert not found.decided_by
            assert "opencv" in found.remark


@pytest.mark.parametrize(
    ("dialects", "words"),
    [
        ({"skimag": {}}, "got 'skimag'; did you mean 'skimage'"),
        ({"opencv": {"win_sise": (64, 128)}}, "'opencv'.*got 'win_sise'; did you mean 'win_size'"),
        ({"skimage": {"orientations": 0}}, "must be an integer"),
        ({"opencv": None}, r"dialects\['opencv'\] must be a dict, got None: write {}"),
    ],
)
def test_dialects_that_there_are_not(dialects: dict[str, Any], words: str) -> None:
    with pytest.raises((TypeError, ValueError), match=words):
        which_hog(np.zeros(3780), dialects=dialects)


@pytest.mark.slow
def test_numbers_that_are_scaled_or_equal_are_remarked_on() -> None:
    noise = np.random.default_rng(0).random(1764)
    assert "exactly 1" in which_hog(noise / noise.max()).remark
    for constant in (0, 0.5, -1):
        found = which_hog(np.full(3780, constant))
        assert not found.candidates
        assert "equal" in found.remark
        assert found.remark in repr(found)
    found = which_hog(noise)
    assert (found.decided_by, found.remark) == ("", "")
    assert len(found.candidates) > MOST_NAMED
    assert repr(found).count(", or ") == MOST_NAMED - 1  # a summary names a few
    assert "undecided" in repr(found)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["opencv", "uoctti", *map(xslow, ("cnn_hog", "dpm", "skimage", "maskfeat"))])
def test_the_candidates_of_bytes_are_those_of_the_numbers_divided_by_255(name: str) -> None:
    found = which_hog(255 * ours(name).ravel())
    assert not found.decided_by
    assert "divided by 255" in found.remark
    assert found.candidates[: found.likely] == recognise(name).candidates[:1]


@pytest.mark.slow
def test_a_factor_is_named_only_if_something_holds_at_that_scale() -> None:
    """What adds up does at any; the largest entry here is a texture, which is no clip."""
    vector = ours("dpm").ravel()
    for original in (vector, ours("dpm")[::-1]):
        assert "they may be" not in which_hog(original / vector.max()).remark


@pytest.mark.slow
@pytest.mark.parametrize("name", ["vlfeat", "dpm", xslow("cnn_hog")])
def test_numbers_in_reverse_order_are_remarked_on(name: str) -> None:
    found = which_hog(ours(name).ravel()[::-1])
    assert not found.decided_by
    assert "reverse order" in found.remark
    assert found.candidates[: found.likely] == recognise(name).candidates[:1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "aubry", "seeing3d"])
def test_what_nothing_exact_holds_of_is_not_decided(name: str) -> None:
    found = which_hog(ours(name))
    assert not found.decided_by
    assert name in {candidate.preset for candidate in found.candidates[: found.likely]}


@pytest.mark.slow
def test_numbers_of_no_preset_are_not_decided() -> None:
    random = np.random.default_rng(0)
    for shape in ((3968,), (8, 8, 31), (5, 1764), (20, 20, 9)):
        assert not which_hog(random.random(shape, np.float32)).decided_by
        assert not which_hog(random.standard_normal(shape)).decided_by
    with pytest.raises(ValueError, match="NaN"):
        which_hog(np.full(36, np.nan))


@pytest.mark.parametrize(
    ("preset", "reason"),
    [("seeing3d", "no other size"), ("dpm", "texture adds up"), ("opencv", "exceeds the clip 0.2")],
)
def test_the_reason_that_is_given(preset: str, reason: str) -> None:
    array = nablahog.hog(np.random.default_rng(0).random((64, 48), np.float32), preset, layout="native")
    assert reason in which_hog(array, (64, 48), dialects={preset: {}}).decided_by


@pytest.mark.slow
def test_columns_of_data_frames_and_summaries() -> None:
    vector = nablahog.hog(np.random.default_rng(0).random((64, 48), np.float32), "skimage", layout="native")
    column = np.empty(2, object)
    column[:] = [vector, vector]
    found = which_hog(column)
    assert found == which_hog(np.stack([vector, vector]))
    assert "skimage() of 64x48" in repr(found)
    assert found.decided_by in repr(found)


@pytest.mark.slow
def test_histograms_of_another_length_are_not_told_by_how_alike_neighbours_are() -> None:
    """Channels one after the other are those of half as many orientations in twice as many rows, and add up as well."""
    names = ("camera", "astronaut", "coffee", "coins", "chelsea", "rocket", "cat", "hubble_deep_field")
    images = [Image.fromarray(getattr(data, name)()).convert("L") for name in names]
    crops = [ImageOps.fit(image, (64, 128), Image.Resampling.BOX) for image in images]
    spec = presets.cnn_hog(orientations=12)
    found = which_hog(np.stack([nablahog.hog(np.asarray(crop), spec, layout="native").ravel() for crop in crops]))
    assert found.decided_by == ""
    assert found.candidates[0].spec == spec
    assert found.candidates[0].image_size == (128, 64)


def test_what_the_library_returns_comes_before_its_layout_and_that_before_others() -> None:
    spec = presets.vlfeat()
    array, layout = np.zeros((31, 16, 8)), spec.layout
    returned = FittedLayout(layout, array.shape, (128, 64))
    same_layout, other_layout = FittedLayout(layout, (31, 8, 16), (64, 128)), FittedLayout("cells", array.shape, (8, 8))
    first, second, third = (Candidate("vlfeat", {}, spec, how) for how in (returned, same_layout, other_layout))
    for candidates, remaining in (([third, second, first], [first]), ([third, second], [second]), ([third], [third])):
        kept, excluded, sentence = check_layout(array, candidates)
        assert (kept, excluded) == (remaining, [each for each in candidates if each not in remaining])
        assert bool(sentence) == bool(excluded)
