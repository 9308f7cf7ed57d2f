"""Arrays of other libraries: which descriptors they are."""

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
from nablahog.requests.arrays import fit_array, likeliest, presets_that_fit, read_stored
from nablahog.requests.inversion import GlyphRequest
from nablahog.requests.options import words

from ..cli.common import CHELSEA

SPEC = presets.vlfeat()
FITS_1764 = ("opencv --set win_size=64x64", "skimage --set cells_per_block=2x2 --image-size 64x64")


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
    result = read_stored(str(path), GlyphRequest(preset="vlfeat"))
    assert (result.spec, result.image_size) == (SPEC, (48, 64))
    assert torch.equal(result.descriptor.double(), torch.from_numpy(values.astype(np.float64)).permute(1, 2, 0))


@pytest.mark.parametrize(
    ("shape", "size", "options"),
    [
        ((3780,), (128, 64), {"--preset opencv", "--preset skimage --set cells_per_block=2x2"}),
        ((1764,), None, {f"--preset {name}" for name in FITS_1764}),
        ((6804,), (128, 64), {"--preset skimage"}),
        ((16, 16, 32), None, {"--preset dpm", "--preset piotr"}),
        ((16, 16, 31), (144, 144), {"--preset dlib"}),
        ((31, 8, 8), None, {"--preset vlfeat", "--preset dlib"}),
    ],
)
def test_what_fits(shape: tuple[int, ...], size: tuple[int, int] | None, options: set[str]) -> None:
    fitting = presets_that_fit(shape, size)
    assert {" ".join(words(each.request, GlyphRequest)) for each in fitting} == options
    for each in fitting:  # works as it stands
        _, how = fit_array(shape, replace(each.request, image_size=each.request.image_size or size))
        assert how.shape == shape
    for nothing in ((), (0,), (5, 0, 31), (100_003,)):
        assert presets_that_fit(nothing, None) == []


def test_which_of_those_that_fit_it_is(tmp_path: Path) -> None:
    """scikit-image's blocks share cells, dlib's cells its weights; OpenCV's votes cannot be told from others."""
    image = data.camera()[100:228, 200:328]
    vector = feature.hog(image, cells_per_block=(2, 2))
    first, second, *_ = likeliest(vector, None)
    skimage = GlyphRequest(preset="skimage", settings={"cells_per_block": "2x2"}, image_size=(128, 128))
    assert first.request == skimage
    assert 2 * first.error < second.error
    first, second = likeliest(nablahog.hog(image, "dlib").transpose(2, 0, 1), None)
    assert first.request == GlyphRequest(preset="dlib")
    assert 2 * first.error < second.error
    opencv = presets.opencv(win_size=(128, 128))
    first, second, *_ = likeliest(nablahog.hog(image, opencv, layout="native"), None)
    assert 2 * first.error > second.error


@pytest.mark.parametrize(
    ("shape", "asked", "message"),
    [
        ((7936,), {"preset": "vlfeat"}, "do not say how large their image was"),
        ((5, 3780), {"preset": "opencv"}, "expected one descriptor in a file, got 5"),
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
