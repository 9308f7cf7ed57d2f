"""Detection side by side with ``cv2.HOGDescriptor``: the same rectangles, in its order, and weights within 1e-5."""

from __future__ import annotations

import runpy
import subprocess
import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from skimage import data

from nablahog.compat import opencv
from nablahog.compat.opencv import HOGDescriptor
from nablahog.compat.opencv.multi_scale import clip, group_rectangles, resize

from .test_opencv import ASTRONAUT, SMALL, pairs

cv2 = pytest.importorskip("cv2")
if not hasattr(cv2, "HOGDescriptor"):
    pytest.skip("OpenCV 5 has no HOG in its main package", allow_module_level=True)

PEOPLE = cv2.HOGDescriptor_getDefaultPeopleDetector()

# a program as OpenCV's sample peopledetect.py: what changes is the first import
SAMPLE = """
import {module} as cv

hog = cv.HOGDescriptor()
hog.setSVMDetector(cv.HOGDescriptor_getDefaultPeopleDetector())
image = cv.imread("people.png")
found, weights = hog.detectMultiScale(image, winStride=(8, 8), padding=(32, 32), scale=1.05)
for x, y, w, h in found:
    cv.rectangle(image, (x, y), (x + w, y + h), (0, 255, 0), 1)
"""


@pytest.fixture(autouse=True)
def _one_thread() -> Any:
    """OpenCV's threads write their results in any order, and weights not in that of rectangles."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(threads)


@cache
def photograph(name: str, size: int, colour: bool) -> np.ndarray:
    """With people, at a width of so many pixels."""
    image = getattr(data, name)()
    image = cv2.resize(image, (size, image.shape[0] * size // image.shape[1]), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(image if colour else image[..., 1])


def both(detector: np.ndarray, *arguments: Any) -> tuple[Any, Any]:
    ours, theirs = HOGDescriptor(*arguments), cv2.HOGDescriptor(*arguments)
    ours.setSVMDetector(detector)
    theirs.setSVMDetector(detector)
    return ours, theirs


@cache
def random_detector(seed: int) -> np.ndarray:
    """Of random weights, with a bias that lets through a fifth of the windows of a photograph."""
    weights = np.random.default_rng(seed).standard_normal(HOGDescriptor(*SMALL).getDescriptorSize())
    windows = cv2.HOGDescriptor(*SMALL).compute(photograph("astronaut", 150, True)).reshape(-1, len(weights))
    return np.append(weights, -np.quantile(windows @ weights, 0.8)).astype(np.float32) / 4


def assert_same(ours: Any, theirs: Any) -> None:
    assert len(ours[0]) == len(theirs[0])
    for mine, others in zip(ours, theirs, strict=True):
        assert type(mine) is type(others)
        if len(others):
            assert (mine.dtype, mine.shape) == (others.dtype, others.shape)
    if len(theirs[0]):
        assert_array_equal(ours[0], theirs[0])
        # a density of the mean shift is a sum over many windows, and may be large
        assert np.abs((ours[1] - theirs[1]) / np.maximum(1, theirs[1])).max() <= 1e-5


# --- people ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"winStride": (8, 8), "padding": (32, 32), "scale": 1.05},
        {"hitThreshold": -0.7, "winStride": (4, 4), "padding": (8, 8), "scale": 1.2, "groupThreshold": 1},
        {"hitThreshold": -0.9, "winStride": (16, 8), "padding": (0, 24), "scale": 1.1, "groupThreshold": 0},
        {"hitThreshold": -0.6, "scale": 1.05, "groupThreshold": 0.1, "useMeanshiftGrouping": True},
    ],
    ids=["defaults", "sample", "offsets", "all", "mean shift"],
)
@pytest.mark.parametrize(("name", "size"), [("astronaut", 320), ("rocket", 300)])
@pytest.mark.parametrize("colour", [False, True])
def test_people(name: str, size: int, colour: bool, options: dict[str, Any]) -> None:
    image = photograph(name, size, colour)
    ours, theirs = both(PEOPLE)
    assert_same(ours.detectMultiScale(image, **options), theirs.detectMultiScale(image, **options))


def test_the_other_people_detector() -> None:
    detector = HOGDescriptor.getDaimlerPeopleDetector()
    assert_array_equal(detector, cv2.HOGDescriptor_getDaimlerPeopleDetector())
    image = photograph("astronaut", 200, False)
    ours, theirs = both(detector, (48, 96), (16, 16), (8, 8), (8, 8), 9)
    assert_same(*(each.detectMultiScale(image, -1, groupThreshold=1) for each in (ours, theirs)))


def test_a_program_with_one_changed_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("people.png", photograph("astronaut", 400, True)[..., ::-1])
    results = {}
    for module in ("cv2", "nablahog.compat.opencv"):
        Path("program.py").write_text(SAMPLE.format(module=module))
        results[module] = runpy.run_path("program.py")
    assert isinstance(results["nablahog.compat.opencv"]["hog"], HOGDescriptor)
    assert_same(*([results[module][name] for name in ("found", "weights")] for module in reversed(results)))
    assert_array_equal(*(result["image"] for result in results.values()))


REPLACEMENTS = {
    "the module, before": "sys.modules['cv2'] = ours",
    "the module, after": "import cv2; sys.modules['cv2'] = ours",
    "the class": "import cv2; cv2.HOGDescriptor = ours.HOGDescriptor",
    "all names of it": "import cv2; cv2.__dict__.update({name: getattr(ours, name) for name in ours.__all__})",
}
# each replacement in a process of its own, into which the package is loaded, but not OpenCV
PROGRAM = """
import os, sys
import nablahog.compat.opencv as ours
assert "cv2" not in sys.modules
for replacement in sys.argv[1:]:
    if os.fork():
        assert os.wait()[1] == 0, replacement
        continue
    exec(replacement)
    import cv2
    detector = cv2.HOGDescriptor.getDefaultPeopleDetector()
    assert ours.HOGDescriptor is cv2.HOGDescriptor
    daimler = cv2.HOGDescriptor_getDaimlerPeopleDetector()
    print(cv2.imread.__name__, detector.shape, float(detector.sum()), daimler.shape, flush=True)
    os._exit(0)
"""


@pytest.mark.slow
def test_programs_where_it_has_taken_the_place_of_opencv() -> None:
    command = [sys.executable, "-c", PROGRAM, *REPLACEMENTS.values()]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert run.returncode == 0, run.stderr
    assert run.stdout == 4 * f"imread {PEOPLE.ravel().shape} {float(PEOPLE.sum())} (1981,)\n"


# --- any detector ----------------------------------------------------------------------------------------------------


@given(
    seed=st.integers(0, 9),
    size=pairs(24, 50),
    colour=st.booleans(),
    stride=pairs(3, 9),
    padding=pairs(-1, 9),
    scale=st.sampled_from([0.9, 1.0, 1.1, 1.37]),
    group=st.sampled_from([0, 1, 2.9]),
    mean_shift=st.booleans(),
)
@settings(max_examples=40)
def test_photographs(seed: int, size: tuple[int, int], colour: bool, stride: Any, padding: Any, **levels: Any) -> None:
    ours, theirs = both(random_detector(seed), *SMALL)
    image = photograph("astronaut", 150, colour)[30 : 30 + size[1], 40 : 40 + size[0]]
    assert_same(ours.detect(image, -0.1, stride, padding), theirs.detect(image, -0.1, stride, padding))
    options = (0.1, stride, padding, *levels.values())
    assert_same(ours.detectMultiScale(image, *options), theirs.detectMultiScale(image, *options))


def test_modes_that_are_near_each_other() -> None:
    """Two, between one and two widths of the kernel squared apart."""
    ours, theirs = both(random_detector(6), *SMALL)
    image = photograph("astronaut", 150, True)[30:72, 40:90]
    expected = theirs.detectMultiScale(image, -0.1, (6, 5), (4, 4), 1.37, 0.0, True)
    assert len(expected[0]) == 2
    assert_same(ours.detectMultiScale(image, -0.1, (6, 5), (4, 4), 1.37, 0.0, True), expected)


def test_places() -> None:
    """Of these, windows beyond the padded image are left out."""
    image = photograph("astronaut", 60, True)
    places = [(0, 0), (7, 3), (44, 36), (45, 36), (-4, 2), (-9, 0), (7, 3)]
    ours, theirs = both(random_detector(3), *SMALL)
    for options in ({}, {"winStride": (4, 8), "padding": (4, 8)}):
        assert_same(*(each.detect(image, -99, searchLocations=places, **options) for each in (ours, theirs)))


@given(size=pairs(1, 80), to=pairs(1, 90), channels=st.sampled_from([1, 3]))
@settings(max_examples=60)
def test_smaller_images_are_opencvs(size: tuple[int, int], to: tuple[int, int], channels: int) -> None:
    image = np.ascontiguousarray(ASTRONAUT[: size[1], : size[0], :channels])
    expected = cv2.resize(image, to, interpolation=cv2.INTER_LINEAR_EXACT).reshape(to[1], to[0], channels)
    assert_array_equal(resize(image, to), expected)


@pytest.mark.parametrize("threshold", [2**31 - 1, 1 - 2**31])
def test_the_most_members_that_a_group_may_need(threshold: int) -> None:
    ours, theirs = both(random_detector(6), *SMALL)
    image = photograph("astronaut", 60, True)
    assert_same(*(each.detectMultiScale(image, groupThreshold=threshold) for each in (ours, theirs)))


def test_windows_without_weight_have_no_mode() -> None:
    ours, theirs = both(np.zeros(HOGDescriptor(*SMALL).getDescriptorSize(), np.float32), *SMALL)
    image = photograph("astronaut", 30, True)
    assert_same(*(each.detectMultiScale(image, useMeanshiftGrouping=True) for each in (ours, theirs)))


# --- groups ----------------------------------------------------------------------------------------------------------


@given(seed=st.integers(0, 2**31 - 1), threshold=st.integers(1, 4))
@settings(max_examples=150)
def test_groups_are_opencvs(seed: int, threshold: int) -> None:
    """Clusters of detections, half of them inside others of more, as many, or fewer members."""
    random = np.random.default_rng(seed)
    rectangles = []
    for _ in range(3):
        outer = np.array([*random.integers(0, 300, 2), *random.integers(60, 120, 2)])
        inner = np.array([*(outer[:2] + random.integers(-25, 30, 2)), *(outer[2:] * random.uniform(0.3, 0.9))])
        for cluster in (outer, inner):
            rectangles += [cluster + random.integers(-3, 4, 4) for _ in range(random.integers(1, 7))]
    shuffled = random.permutation(np.array(rectangles, np.int32))
    expected, _ = cv2.groupRectangles(shuffled.tolist(), threshold, 0.2)
    grouped, weights = group_rectangles(shuffled, np.arange(len(shuffled), dtype=float), threshold)
    assert_array_equal(grouped, np.array(expected, np.int32).reshape(-1, 4))
    for rectangle, weight in zip(grouped, weights, strict=True):
        assert np.abs(shuffled[int(weight)] - rectangle).max() <= 40  # the largest weight is a member's


def test_of_rectangles_the_part_within_the_image_is_left() -> None:
    """If there is any, be it one pixel; sides are of (x, y, width, height)."""
    rectangles = np.array([[-7, -3, 8, 9], [-8, 0, 8, 9], [19, 2, 5, 9], [3, 29, 5, 9], [3, 30, 5, 9]], np.int32)
    left, weights = clip(rectangles, np.arange(5.0), (20, 30))
    assert left.tolist() == [[0, 0, 1, 6], [19, 2, 1, 9], [3, 29, 5, 1]]
    assert weights.tolist() == [0, 2, 3]


# --- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {"hitThreshold": "0"},
        {"hitThreshold": 10**400},
        {"winStride": (8, -8)},
        {"scale": True},
        *({"groupThreshold": members} for members in (2**31, -(2**31), np.nan)),
        {"useMeanshiftGrouping": 1.0},
    ],
)
def test_options_are_refused(options: dict[str, Any]) -> None:
    """OpenCV's own errors are :class:`cv2.error`, where it does not crash."""
    with pytest.raises((TypeError, ValueError), match=f"^{next(iter(options))} must be "):
        both(PEOPLE)[0].detectMultiScale(np.zeros((128, 64), np.uint8), **options)


def test_detectors_are_refused() -> None:
    descriptor = HOGDescriptor()
    with pytest.raises(ValueError, match=r"the 3780 coefficients .* got an array of the shape \(10,\)"):
        descriptor.setSVMDetector(np.zeros(10))
    with pytest.raises(TypeError, match="an array of numbers"):
        descriptor.setSVMDetector(np.array(["a"]))
    assert descriptor.svmDetector == ()


# --- OpenCV's coefficients -------------------------------------------------------------------------------------------


def test_people_detectors_are_opencvs() -> None:
    ours = HOGDescriptor.getDefaultPeopleDetector()
    assert_array_equal(ours, PEOPLE)
    assert ours.dtype == PEOPLE.dtype
    assert_array_equal(opencv.HOGDescriptor_getDefaultPeopleDetector(), PEOPLE)


def test_people_detectors_from_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    both(PEOPLE)[1].save(str(tmp_path / "default.yml"))
    both(random_detector(0), *SMALL)[1].save(str(tmp_path / "daimler.yml"))
    monkeypatch.setenv("NABLAHOG_PEOPLE_DETECTORS", str(tmp_path))
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert_array_equal(HOGDescriptor.getDefaultPeopleDetector(), PEOPLE)
    with pytest.raises(ValueError, match="expected the 1981 coefficients of getDaimlerPeopleDetector"):
        HOGDescriptor.getDaimlerPeopleDetector()


@pytest.mark.parametrize("installed", [None, ModuleType("cv2")], ids=["no OpenCV", "OpenCV 5"])
def test_without_opencvs_coefficients(installed: ModuleType | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", installed)  # type: ignore[arg-type]
    monkeypatch.delenv("NABLAHOG_PEOPLE_DETECTORS", raising=False)
    with pytest.raises(RuntimeError, match="NABLAHOG_PEOPLE_DETECTORS"):
        HOGDescriptor.getDefaultPeopleDetector()


def test_other_names_are_opencvs(monkeypatch: pytest.MonkeyPatch) -> None:
    assert opencv.imread is cv2.imread
    constants = [name for name in dir(cv2) if name.startswith("HOGDescriptor_") and not name.endswith("Detector")]
    assert constants
    assert {name: opencv.__dict__[name] for name in constants} == {name: getattr(cv2, name) for name in constants}
    with pytest.raises(AttributeError):
        _ = opencv.no_such_name
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(AttributeError, match="OpenCV, which may have it, is not installed"):
        _ = opencv.imread
