"""Side by side with ``cv2.HOGDescriptor``; thresholds are all 0.2 here, as OpenCV keeps the first one of a process."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage import data

from nablahog import hog, presets
from nablahog.compat.opencv import HOGDescriptor

from .test_opencv_storage import NAMES

cv2 = pytest.importorskip("cv2")
if not hasattr(cv2, "HOGDescriptor"):
    pytest.skip("OpenCV 5 has no HOG in its main package", allow_module_level=True)

TOLERANCE = 2e-6  # of the default descriptor
ASTRONAUT = data.astronaut()
FIVE = ((64, 128), (16, 16), (8, 8), (8, 8), 9)
SMALL = ((16, 24), (8, 8), (4, 8), (4, 4), 6)


def pairs(low: int, high: int) -> st.SearchStrategy[tuple[int, int]]:
    return st.tuples(st.integers(low, high), st.integers(low, high))


def crop(seed: int, height: int, width: int, colour: bool, levels: int = 256) -> np.ndarray:
    """Somewhere in a photograph; of few levels if you want many ties of channels."""
    row, col = np.random.default_rng(seed).integers(0, 300, 2)
    image = ASTRONAUT[row : row + height, col : col + width]
    image = image // (256 // levels) * (256 // levels)
    return np.ascontiguousarray(image if colour else image[..., 0])


def assert_same(arguments: tuple[Any, ...], image: np.ndarray, *options: Any, **named: Any) -> None:
    ours, theirs = (make(*arguments).compute(image, *options, **named) for make in (HOGDescriptor, cv2.HOGDescriptor))
    assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape)
    # two float32 arctangents differ by up to 1e-6; in bins, and normalised again after the clip, an entry by more
    bins = arguments[4] if arguments else 9
    assert np.abs(ours - theirs).max(initial=0) <= (TOLERANCE * bins / np.pi if arguments else TOLERANCE)


# --- constructor -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        FIVE,
        SMALL,
        (*SMALL, 3, 2.5, 0, 0.2, True, 13, True),
        ([16, 24], np.array([8, 8]), (np.int64(4), 8), [4, 4], np.int32(6)),
    ],
    ids=["none", "five", "small", "all", "sequences"],
)
def test_attributes(arguments: tuple[Any, ...]) -> None:
    ours, theirs = HOGDescriptor(*arguments), cv2.HOGDescriptor(*arguments)
    for name in NAMES:
        assert getattr(ours, name) == getattr(theirs, name), name
        assert type(getattr(ours, name)) is type(getattr(theirs, name)), name
        with pytest.raises(AttributeError):
            setattr(ours, name, getattr(ours, name))
    assert ours.getDescriptorSize() == theirs.getDescriptorSize()


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_five_arguments_or_none(count: int) -> None:
    with pytest.raises(TypeError, match="at least the first five"):
        HOGDescriptor(*FIVE[:count])
    with pytest.raises(cv2.error):
        cv2.HOGDescriptor(*FIVE[:count])


@pytest.mark.parametrize(
    "arguments", [((64, 128), (16, 16), (7, 8), (8, 8), 9), ((64, 128), (16, 16), (8, 8), (8, 5), 9)]
)
def test_sizes_suit_each_other(arguments: tuple[Any, ...]) -> None:
    with pytest.raises(ValueError, match="a block must be whole cells"):
        HOGDescriptor(*arguments)
    with pytest.raises(cv2.error):
        cv2.HOGDescriptor(*arguments).getDescriptorSize()


@pytest.mark.parametrize(
    ("name", "taken", "refused"),
    [
        ("nbins", 3, 2),
        ("nbins", 128, 129),
        ("L2HysThreshold", 5e-324, 0.0),
        ("L2HysThreshold", np.inf, np.nan),
        ("nlevels", 1, 0),
    ],
)
def test_parameters_without_a_descriptor(name: str, taken: float, refused: float) -> None:
    arguments: Any = FIVE[: 4 if name == "nbins" else 5]
    assert getattr(HOGDescriptor(*arguments, **{f"_{name}": taken}), name) == taken
    with pytest.raises(ValueError, match=f"^{name} must be "):
        HOGDescriptor(*arguments, **{f"_{name}": refused})


# --- descriptors -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@given(
    seed=st.integers(0, 99),
    sizes=st.tuples(pairs(2, 9), pairs(1, 3), pairs(1, 9), pairs(0, 3), pairs(0, 20)),
    nbins=st.integers(4, 20),
    sigma=st.sampled_from([-1.0, 0.0, 1.5, 9.0]),
    flags=st.tuples(st.booleans(), st.booleans()),
    kind=st.tuples(st.booleans(), st.sampled_from([2, 4, 256])),
    winStride=st.none() | pairs(1, 12),
    padding=st.none() | pairs(-4, 40),
)
@settings(max_examples=150)
def test_photographs(
    seed: int, sizes: Any, nbins: int, sigma: float, flags: Any, kind: tuple[bool, int], **options: Any
) -> None:
    """By the class and, of one window, by the preset.  All sizes are (width, height)."""
    cell, cells, step, steps, spare = sizes
    block = (cell[0] * cells[0], cell[1] * cells[1])
    window = (block[0] + step[0] * steps[0], block[1] + step[1] * steps[1])
    image = crop(seed, window[1] + spare[1], window[0] + spare[0], *kind)
    arguments = (window, block, step, cell, nbins, 1, sigma, 0, 0.2, flags[0], 64, flags[1])
    assert_same(arguments, image, **options)
    image = np.ascontiguousarray(image[: window[1], : window[0]])
    spec = presets.opencv(*arguments[:5], win_sigma=sigma, gamma=flags[0], signed=flags[1])
    expected = cv2.HOGDescriptor(*arguments).compute(image)
    np.testing.assert_allclose(hog(image, spec, layout="native"), expected, rtol=0, atol=1e-5)


@given(
    seed=st.integers(0, 99),
    locations=st.lists(pairs(-30, 60), max_size=12),
    winStride=st.none() | pairs(1, 12),
    padding=st.none() | pairs(0, 40),
)
@settings(max_examples=60)
def test_locations(seed: int, **options: Any) -> None:
    """Zeros for windows that are not in the padded image; all windows if there is no location."""
    assert_same(SMALL, crop(seed, 53, 47, colour=True), **options)


def test_arrays_that_opencv_keeps_elsewhere() -> None:
    image, weights = crop(1, 128, 64, colour=True), np.linspace(-1, 1, 3781, dtype=np.float32)
    hog = HOGDescriptor()
    whole = cv2.UMat(image)
    for same in (whole, cv2.UMat(whole, (0, 128), (0, 64))):
        np.testing.assert_array_equal(hog.compute(same), hog.compute(image))
    with pytest.raises(ValueError, match="img must be a whole UMat"):
        hog.compute(cv2.UMat(whole, (0, 128), (0, 63)))
    hog.setSVMDetector(cv2.UMat(weights[:, None]) if hog.checkDetectorSize() else None)
    np.testing.assert_array_equal(hog.svmDetector, weights)


@pytest.mark.parametrize("size", [(128, 64), (200, 131), (131, 70)])
@pytest.mark.parametrize("colour", [False, True])
def test_the_defaults(size: tuple[int, int], colour: bool) -> None:
    image = crop(1, *size, colour=colour)
    assert_same((), image)
    assert_same((), image, winStride=(16, 8), padding=(8, 16))
    assert_same((), image, (0, 0), (0, 0), ())
    assert_same((), image, padding=(32, 32), locations=np.array([[0, 0], [-32, -32]], np.int32))


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (2, 3), (5, 2)])
def test_tiny_images_are_mirrored_as_often_as_it_takes(size: tuple[int, int]) -> None:
    for colour in (False, True):
        assert_same(SMALL, crop(2, *size, colour=colour), (4, 8), (40, 56))


@pytest.mark.parametrize("padding", [(), ((3, 4), (5, 6)), ((0, 9), None)])
@pytest.mark.parametrize("colour", [False, True])
def test_gradients_of_pixels(padding: tuple[Any, ...], colour: bool) -> None:
    image = crop(6, 31, 43, colour, levels=16)
    (ours, our_bins), (theirs, their_bins) = (
        make(*SMALL).computeGradient(image, None, None, *(each or (0, 0) for each in padding))
        for make in (HOGDescriptor, cv2.HOGDescriptor)
    )
    assert (ours.dtype, ours.shape, our_bins.dtype) == (theirs.dtype, theirs.shape, their_bins.dtype)
    near = np.abs(ours - theirs).max(axis=2) <= 1e-4  # votes reach 360
    assert np.mean(near & (our_bins == their_bins).all(axis=2)) > 0.99  # right on a bin's centre the rounding decides
    assert np.abs(ours.sum(axis=2) - theirs.sum(axis=2)).max() <= 1e-4


def test_of_an_image_a_pixel_must_be_left() -> None:
    image = crop(6, 31, 43, colour=False)
    for make in (HOGDescriptor, cv2.HOGDescriptor):
        assert make(*SMALL).computeGradient(image, None, None, (-20, 0), (-22, -30))[0].shape == (1, 1, 2)
    for after in ((-23, 0), (0, -31)):
        with pytest.raises(ValueError, match="must leave pixels of the image"):
            HOGDescriptor(*SMALL).computeGradient(image, None, None, (-20, 0), after)


VOTES = np.zeros((62, 86, 2), np.float32)


@pytest.mark.parametrize(
    "grad",
    [VOTES[:31, :43], VOTES[::2, :43], VOTES, np.zeros((31, 43, 2)), np.array(1, np.float32), 1.5, (1,), True],
    ids=["crop", "every other row", "larger", "float64", "no axes", "number", "tuple", "truth value"],
)
def test_arrays_that_votes_are_written_to(grad: Any) -> None:
    """They are written to, or not, as by OpenCV."""
    image, written = crop(6, 31, 43, colour=False), []
    for make in (HOGDescriptor, cv2.HOGDescriptor):
        VOTES[:] = 0
        votes, _ = make(*SMALL).computeGradient(image, grad, None)
        np.testing.assert_array_equal(votes, make(*SMALL).computeGradient(image, None, None)[0])
        written.append(votes is grad)
    assert written[0] == written[1]


@pytest.mark.parametrize(
    ("grad", "words"),
    [
        (VOTES[:31, ::2], "row by row"),
        (VOTES[30::-1, :43], "row by row"),
        (np.frombuffer(bytes(8 * 31 * 43), np.float32).reshape(31, 43, 2), "row by row"),
        (np.zeros((31, 43, 2), np.int64), "numbers that OpenCV knows, got int64"),
        (np.zeros((31, 43, 2), bool), "numbers that OpenCV knows, got bool"),
        ([1.0], "None or an array to write to, got list"),
        ("1", "None or an array to write to, got str"),
    ],
    ids=["every other column", "upside down", "read only", "int64", "bool", "list", "text"],
)
def test_other_arrays_are_refused_as_by_opencv(grad: Any, words: str) -> None:
    for make, error, match in ((HOGDescriptor, (TypeError, ValueError), words), (cv2.HOGDescriptor, cv2.error, "grad")):
        with pytest.raises(error, match=match):
            make(*SMALL).computeGradient(crop(6, 31, 43, colour=False), grad, None)


@pytest.mark.parametrize("place", range(3))
def test_gradients_where_opencv_keeps_arrays_elsewhere(place: int) -> None:
    image = crop(6, 31, 43, colour=True)
    expected = HOGDescriptor(*SMALL).computeGradient(image, None, None)
    for make in (HOGDescriptor, cv2.HOGDescriptor):
        arrays: list[Any] = [image, np.zeros((31, 43, 2), np.float32), np.zeros((31, 43, 2), np.uint8)]
        arrays[place] = cv2.UMat(arrays[place])
        results = make(*SMALL).computeGradient(*arrays)
        for result, numbers in zip(results, expected, strict=True):
            assert isinstance(result, cv2.UMat)
            np.testing.assert_allclose(result.get(), numbers, rtol=0, atol=1e-3)
        if place:  # it is written to
            np.testing.assert_allclose(arrays[place].get(), expected[place - 1], rtol=0, atol=1e-3)


def test_each_object_has_its_own_threshold() -> None:
    """OpenCV in a process of its own says what it is: here, the process has used 0.2."""
    arguments = (*FIVE, 1, -1, 0, 0.05)
    program = f"""
import cv2, numpy, sys
image = numpy.frombuffer(sys.stdin.buffer.read(), numpy.uint8).reshape(128, 64, 3)
sys.stdout.buffer.write(cv2.HOGDescriptor(*{arguments!r}).compute(image).tobytes())
"""
    image = crop(5, 128, 64, colour=True)
    run = subprocess.run([sys.executable, "-c", program], input=image.tobytes(), capture_output=True, check=True)
    expected = np.frombuffer(run.stdout, np.float32)
    assert np.abs(HOGDescriptor(*arguments).compute(image) - expected).max() <= TOLERANCE
    assert np.abs(HOGDescriptor(*FIVE).compute(image) - expected).max() > 0.05


# --- refusals --------------------------------------------------------------------------------------------------------


def test_without_a_detector_nothing_is_found() -> None:
    for each in (HOGDescriptor(), cv2.HOGDescriptor()):
        for size in ((128, 64), (20, 20)):  # the latter has no window
            assert each.detectMultiScale(np.zeros(size, np.uint8)) == ((), ())
            assert each.detect(np.zeros(size, np.uint8)) == ((), ())


@pytest.mark.parametrize(
    "image", [None, np.zeros((128, 64)), *(np.zeros(s, np.uint8) for s in ((128, 64, 4), (128, 63)))]
)
@pytest.mark.parametrize("method", ["compute", "detect", "detectMultiScale"])
def test_images_are_refused(method: str, image: Any) -> None:
    """OpenCV's own errors are :class:`cv2.error`; images smaller than a window make it crash."""
    descriptor = HOGDescriptor()
    descriptor.setSVMDetector(descriptor.getDefaultPeopleDetector())
    with pytest.raises((TypeError, ValueError), match=r"^(img|the image) must "):
        getattr(descriptor, method)(image)


@pytest.mark.parametrize(
    "options",
    [
        {"winStride": None, "padding": None, "locations": None},
        {"winStride": [8, np.uint8(8)], "padding": (None, 8)},
        {"padding": np.array([-8, 8], np.int16), "locations": []},
        {"locations": [None, (16, 8)]},
        {"locations": np.array([[0, 0], [16, 8]], np.uint8)},
    ],
)
def test_odd_options(options: dict[str, Any]) -> None:
    image = crop(0, 160, 96, True)
    expected = cv2.HOGDescriptor().compute(image, **options)
    assert np.abs(HOGDescriptor().compute(image, **options) - expected).max() <= TOLERANCE


def test_what_crashes_opencv_is_refused() -> None:
    with pytest.raises(ValueError, match="winStride must be at least 1"):
        HOGDescriptor().compute(crop(0, 160, 96, True), winStride=(8, 0))


@pytest.mark.parametrize("pair", [8, (8, 8, 8), (True, 8), (np.True_, 8), (8.0, 8), ("8", 8), (2**31, 8), {8: 8}])
@pytest.mark.parametrize("name", ["winStride", "padding", "locations"])
def test_options_are_refused(name: str, pair: Any) -> None:
    image, options = crop(0, 160, 96, True), {name: [pair] if name == "locations" else pair}
    with pytest.raises(TypeError, match="must be a pair"):
        HOGDescriptor().compute(image, **options)
    with pytest.raises(cv2.error):
        cv2.HOGDescriptor().compute(image, **options)


def test_locations_in_a_umat_are_refused() -> None:
    corners = cv2.UMat(np.zeros((1, 2), np.int32))
    for each, error in ((HOGDescriptor, TypeError), (cv2.HOGDescriptor, cv2.error)):
        with pytest.raises(error, match="locations"):
            each().compute(crop(0, 160, 96, True), locations=corners)


LARGE = [pytest.param(2**n, id=f"2**{n}") for n in (1023, 1024)]  # the first fits into 64 bits, as a float


@pytest.mark.parametrize("place", range(5, 12))
@pytest.mark.parametrize("argument", [None, np.int64(1), np.float32(1), True, np.True_, 1.5, "1", np.array(1), *LARGE])
def test_odd_constants(place: int, argument: Any) -> None:
    """Each is taken or refused as by OpenCV."""
    arguments = [*SMALL, 1, -1.0, 0, 0.2, True, 64, False]
    arguments[place] = argument
    try:
        theirs = cv2.HOGDescriptor(*arguments)
    except cv2.error:
        with pytest.raises(TypeError):
            HOGDescriptor(*arguments)
        return
    ours = HOGDescriptor(*arguments)
    assert [getattr(ours, name) for name in NAMES] == [getattr(theirs, name) for name in NAMES]
