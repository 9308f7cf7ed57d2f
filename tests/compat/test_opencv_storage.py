"""Files of ``cv2.HOGDescriptor``: what OpenCV writes is read, and the other way round."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from nablahog.compat.opencv import HOGDescriptor

NAMES = (
    *("winSize", "blockSize", "blockStride", "cellSize", "nbins", "derivAperture", "winSigma", "histogramNormType"),
    *("L2HysThreshold", "gammaCorrection", "nlevels", "signedGradient"),
)
SMALL = ((16, 24), (8, 8), (4, 8), (4, 4), 6, 1, 2.5, 0, 0.2, True, 13, True)
ENDINGS = ["yml", "yaml", "xml", "json", "txt", "yml.gz", "xml.gz"]


def detector(size: int) -> np.ndarray:
    """Numbers that a text may get wrong: of all magnitudes, whole ones, and zero."""
    random = np.random.default_rng(0)
    numbers = random.standard_normal(size) * 10.0 ** random.integers(-30, 30, size)
    numbers[:5] = 0, 1, -100, 2**24, 1 / 3
    return numbers.astype(np.float32)


def with_detector(descriptor: Any) -> Any:
    descriptor.setSVMDetector(detector(descriptor.getDescriptorSize() + 1))
    return descriptor


def assert_equal(one: Any, other: Any) -> None:
    assert [getattr(one, name) for name in NAMES] == [getattr(other, name) for name in NAMES]
    assert_array_equal(one.svmDetector, other.svmDetector)


@pytest.mark.parametrize("ending", ENDINGS)
def test_opencv_reads_and_writes_the_same(ending: str, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    ours, theirs = with_detector(HOGDescriptor(*SMALL)), with_detector(cv2.HOGDescriptor(*SMALL))
    path, other = str(tmp_path / f"some file.{ending}"), str(tmp_path / f"other.{ending}")
    ours.save(path)
    assert_equal(cv2.HOGDescriptor(path), ours)
    theirs.save(other)
    loaded = HOGDescriptor(other)
    assert_equal(loaded, ours)
    assert loaded.load(other, "other") is True


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_saved_is_loaded(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{ending}"
    saved = with_detector(HOGDescriptor(*SMALL))
    saved.save(path, "my_object")
    assert_equal(HOGDescriptor(path), saved)
    with pytest.raises(ValueError, match="expected a HOGDescriptor named 'other', got none"):
        HOGDescriptor().load(path, "other")


@pytest.mark.parametrize(
    ("filename", "objname"),
    [
        *((name, "") for name in ("a.b.yml", "a.", "1.yml", "..yml", ".a.yml", ".a.yml.gz", "_.xml")),
        *((".yml", "a"), ("a.yml", "a b"), ("a.yml", "_"), ("a.xml", "__"), ("a.xml", "a-1"), (b"a.xml", None)),
    ],
)
def test_names_are_those_of_opencv(
    filename: Any, objname: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cv2 = pytest.importorskip("cv2")
    monkeypatch.chdir(tmp_path)
    names = []
    for make in (HOGDescriptor, cv2.HOGDescriptor):
        make(*SMALL).save(filename, objname)
        storage = cv2.FileStorage(filename, cv2.FILE_STORAGE_READ)
        names.append(storage.root().keys())
    assert names[0] == names[1]


@pytest.mark.parametrize(
    ("filename", "objname", "words"),
    [
        (3, "", "filename must be a string, got 3"),
        ("a.yml", 0, "objname must be a string, got 0"),
        *((name, "", "more than its ending") for name in ("", ".yml", ".yml.gz", ".a.gz")),
        *(("a.yml", name, "objname must be ASCII letters") for name in ("1a", "-a", "aé", "a.b", "a\n")),
        *(("a.xml", name, "objname must be ASCII letters") for name in ("a b", "_")),
    ],
)
def test_other_names_are_refused(
    filename: Any, objname: Any, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenCV's own errors are :class:`cv2.error` and TypeError."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises((TypeError, ValueError), match=words):
        HOGDescriptor(*SMALL).save(filename, objname)
    assert not any(tmp_path.iterdir())


FILE = """%YAML:1.0
---
a: !!opencv-object-detector-hog
   winSize: [ 16, 24 ]
   blockSize: [ 8, 8 ]
   blockStride: [ 4, 8 ]
   cellSize: [ 4, 4 ]
   nbins: 6
"""


LONG = '{"a": {"winSize": [' + 3000 * "1, " + '"' + 10**6 * "x" + '"]}}'  # 12 GB as an array of texts


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("hello", "expected a FileStorage of OpenCV: it begins with 'hello'"),
        ("{", "expected a FileStorage of OpenCV"),
        ('<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><a/>', "XML with a DOCTYPE is not read"),
        (FILE.replace("16, 24", "16"), "winSize must have length 2, got 1"),
        (FILE.replace("16, 24", "16.5, 24"), "winSize must be integers"),
        (FILE.replace("nbins: 6", "nbins: x"), "nbins must be numbers, got x"),
        (FILE + "   SVMDetector: [ 1., 2. ]\n", "svmdetector must be the 216 coefficients"),
        (FILE + "   SVMDetector: [ 1., 2.,\n       3.", r"'SVMDetector: \[ 1., 2., 3.' is no entry"),  # cut
        (FILE.replace("nbins: 6", "nbins: ٦"), "nbins must be numbers, got ٦"),
        ('{"a": {"winSize": [[1], [2, 3]]}}', r"winSize must be numbers, got \[\[1\], \[2, 3\]\]"),
        ("%YAML:1.0\n---\nopencv_ml_svm:\n   support_vectors:\n      - [ 1. ]\n", "getSupportVectors"),
        ("<opencv_storage><opencv_ml_svm></opencv_ml_svm></opencv_storage>", "getSupportVectors"),
        ('{"opencv_ml_svm": {"format": 3}}', "getSupportVectors"),
        (LONG, "winSize must be numbers, got"),
        ("<a>" + 100_000 * "<b/>" + "</a>", "it has more than 100,000 tags"),
    ],
)
def test_damaged_files_are_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.yml"
    path.write_text(text)
    descriptor = with_detector(HOGDescriptor())
    with pytest.raises(ValueError, match=words):
        descriptor.load(path)
    assert_equal(descriptor, with_detector(HOGDescriptor()))


def test_files_that_unpack_to_too_much_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.yml.gz").write_bytes(gzip.compress(b" " * (2**23 + 1)))
    with pytest.raises(ValueError, match="larger than 8,388,608 bytes"):
        HOGDescriptor(tmp_path / "a.yml.gz")


def test_a_large_svm_is_answered_with_the_line_that_saves_its_weights(tmp_path: Path) -> None:
    (tmp_path / "svm.yml").write_bytes(b"%YAML:1.0\n---\nopencv_ml_svm:\n" + b" " * 2**23)
    with pytest.raises(ValueError, match="getSupportVectors"):
        HOGDescriptor(tmp_path / "svm.yml")


def test_a_packed_file_that_is_cut_is_refused(tmp_path: Path) -> None:
    packed = gzip.compress((FILE + "   nlevels: 7\n").encode())
    (tmp_path / "a.yml.gz").write_bytes(packed)
    assert HOGDescriptor(tmp_path / "a.yml.gz").nlevels == 7
    (tmp_path / "a.yml.gz").write_bytes(packed[:-9])
    with pytest.raises(ValueError, match="it cannot be unpacked: Compressed file ended before"):
        HOGDescriptor(tmp_path / "a.yml.gz")


def test_what_a_hand_may_write_is_read(tmp_path: Path) -> None:
    text = FILE.replace("---\n", "").replace("nbins: 6", "nbins:  6   # bins") + "   # no detector\n...\n"
    (tmp_path / "a.yml").write_text(text.replace("\n", "\r\n"))
    assert HOGDescriptor(tmp_path / "a.yml").nbins == 6


def test_there_must_be_a_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such file"):
        HOGDescriptor(tmp_path / "a.yml")
    with pytest.raises(ValueError, match="got a folder"):
        HOGDescriptor(tmp_path)
    with pytest.raises(TypeError, match="filename must be a string, got 5"):
        HOGDescriptor().load(5)  # type: ignore[arg-type]
