"""Descriptor files: what is saved comes back, and what is wrong is refused; every layout of an array is recognised."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import torch
from numpy.typing import NDArray

import nablahog
from nablahog import HOGSpec, presets
from nablahog.io.descriptor_file import (
    FittedLayout,
    find_layout,
    load_descriptor,
    save_descriptor,
    shapes,
    to_descriptor,
)
from nablahog.requests.dialect import PRESETS, make_spec

SIZE = (40, 29)


def _descriptor(spec: HOGSpec, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    return nablahog.hog(torch.rand(1, 3, *SIZE, dtype=dtype, generator=torch.Generator().manual_seed(0)), spec)[0]


def _arrays(**changed: Any) -> dict[str, Any]:
    spec = presets.uoctti()
    arrays = {
        "format": np.array(1),
        "descriptor": _descriptor(spec).numpy(),
        "spec": np.array(spec.to_json()),
        "image_size": np.array(SIZE),
    }
    arrays.update(changed)
    return {name: value for name, value in arrays.items() if value is not None}


@pytest.mark.parametrize("spec", [presets.paper((8, 5)), presets.uoctti(vote="hard")], ids=lambda spec: spec.name)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_round_trip(tmp_path: Path, spec: HOGSpec, dtype: torch.dtype) -> None:
    descriptor = _descriptor(spec, dtype)
    save_descriptor(tmp_path / "d", descriptor.requires_grad_(), spec, SIZE)
    assert os.listdir(tmp_path) == ["d"]
    found = load_descriptor(tmp_path / "d")
    assert found.spec == spec
    assert found.image_size == SIZE
    assert found.descriptor.dtype == dtype
    assert torch.equal(found.descriptor, descriptor)
    assert repr(found) == f"<StoredDescriptor {'x'.join(map(str, descriptor.shape))}, image 40x29, {spec!r}>"


def _with(value: float) -> np.ndarray[Any, Any]:
    descriptor = _descriptor(presets.uoctti()).numpy().copy()
    descriptor[1, 2, 3] = value
    return descriptor


WRONG = {
    "NaN": ({"descriptor": _with(np.nan)}, "must be finite, got NaN or Inf"),
    "too few channels": (
        {"descriptor": _descriptor(presets.uoctti())[..., :30].numpy()},
        r"40x29 pixels has shape \(5, 4, 31\) \(rows, cols, channels\), got \(5, 4, 30\)",
    ),
    "another spec": ({"spec": np.array(presets.paper().to_json())}, r"a paper descriptor .* got \(5, 4, 31\)"),
    "another size": ({"image_size": np.array([400, 29])}, r"400x29 pixels has shape \(50, 4, 31\)"),
    "no image": ({"image_size": np.array([0, 29])}, "image_size must be"),
    "a huge image": (
        {"spec": np.array(presets.uoctti(100_000).to_json()), "image_size": np.array([500_000, 400_000])},
        "at most 89,478,485 pixels",
    ),
    "a size of three": ({"image_size": np.array([40, 29, 3])}, r"two integers .* shape \(3,\)"),
    "integers": ({"descriptor": np.zeros((5, 4, 31), np.int32)}, "float32 or float64, got int32"),
    "no descriptor": ({"descriptor": None}, "the archive lacks descriptor"),
    "no JSON": ({"spec": np.array("{")}, "not the JSON of a HOGSpec"),
    "deep JSON": ({"spec": np.array("[" * 100_000)}, "."),
    "a later format": ({"format": np.array(2)}, "files of format 1, got 2"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_contents(tmp_path: Path, what: str) -> None:
    changed, message = WRONG[what]
    np.savez(tmp_path / "d.npz", **_arrays(**changed))
    with pytest.raises(ValueError, match=message) as caught:
        load_descriptor(tmp_path / "d.npz")
    assert str(caught.value).startswith(f"{tmp_path / 'd.npz'}: ")
    assert "\n" not in str(caught.value)


def test_images_of_as_many_pixels_as_are_allowed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez(tmp_path / "d.npz", **_arrays())
    monkeypatch.setattr(PIL.Image, "MAX_IMAGE_PIXELS", SIZE[0] * SIZE[1])
    load_descriptor(tmp_path / "d.npz")
    monkeypatch.setattr(PIL.Image, "MAX_IMAGE_PIXELS", SIZE[0] * SIZE[1] - 1)
    with pytest.raises(ValueError, match="at most 1,159 pixels, got 40x29"):
        load_descriptor(tmp_path / "d.npz")


class _Bomb:
    """Unpickling this makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, (str(self.path),)


def test_pickles_are_never_loaded(tmp_path: Path) -> None:
    bomb = np.array([_Bomb(tmp_path / "gone off")], dtype=object)
    np.savez(tmp_path / "d.npz", **_arrays(descriptor=bomb))
    with pytest.raises(ValueError, match="pickled objects, which are never loaded"):
        load_descriptor(tmp_path / "d.npz")
    np.load(tmp_path / "d.npz", allow_pickle=True)["descriptor"]  # the bomb is live:
    assert (tmp_path / "gone off").exists()


def test_archives_that_swell(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "d.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("descriptor.npy", "w", force_zip64=True) as member:
            member.write(b"\0")
        archive.filelist[0].file_size = 2**40  # what the directory of the archive will claim
    with pytest.raises(ValueError, match="unpacks to 1,099,511,627,776 bytes"):
        load_descriptor(tmp_path / "d.npz")


# --- arrays of other libraries

IMAGE = (40, 64)
VARIANTS: dict[str, HOGSpec] = {
    **{name: make_spec(name, {}) for name in PRESETS},
    "skimage-blocks": presets.skimage(cells_per_block=(2, 3), feature_vector=False),
    "vlfeat-dalaltriggs": presets.vlfeat("dalaltriggs"),
    "opencv-stride": presets.opencv((64, 48), (24, 16), (4, 8), (12, 8), 5),
}


def _native(spec: HOGSpec, size: tuple[int, int] = IMAGE) -> tuple[NDArray[Any], torch.Tensor]:
    """What the library returns, and the descriptor, of one random image."""
    image = torch.rand(1, 3, *size, generator=torch.Generator().manual_seed(0))
    return nablahog.hog(image, spec, layout="native")[0].numpy(), nablahog.hog(image, spec)[0]


@pytest.mark.parametrize("name", VARIANTS)
def test_every_layout_comes_back(name: str) -> None:
    spec = VARIANTS[name]
    native, descriptor = _native(spec)
    height, width = spec.image_size(*descriptor.shape[:2])
    for array in (native, descriptor.numpy(), native.ravel(), np.asfortranarray(native)):
        for batched in (array, array[None]):
            for size in (IMAGE, None) if array.ndim > 1 else (IMAGE,):
                how = find_layout(batched.shape, spec, size)
                assert how is not None
                assert how.image_size == (size or (height, width))
                result = to_descriptor(batched, spec, how)
                assert (result.spec, result.image_size) == (spec, how.image_size)
                assert torch.equal(result.descriptor, descriptor)


def test_layouts_that_libraries_have_besides() -> None:
    for spec in (presets.skimage(), presets.skimage(feature_vector=False)):
        _, descriptor = _native(spec)
        for shape in ((3, 6, 3, 3, 9), (3, 6, 81), (1, 1458)):
            how = find_layout(shape, spec, IMAGE)
            assert how is not None
            assert torch.equal(to_descriptor(descriptor.numpy().reshape(shape), spec, how).descriptor, descriptor)
    spec = presets.maskfeat()
    native, descriptor = _native(spec)
    how = find_layout((27, 5, 8), spec, None)
    assert how == FittedLayout("planes", (27, 5, 8), IMAGE)
    assert torch.equal(to_descriptor(native.reshape(27, 5, 8), spec, how).descriptor, descriptor)
    assert find_layout((3780, 1), presets.opencv(), (128, 64)) == FittedLayout(
        "opencv-vector", (3780,), (128, 64)
    )  # of older versions


def test_shapes_in_messages() -> None:
    assert shapes(presets.uoctti(), None) == "(rows, cols, 31)"
    assert shapes(presets.maskfeat(), None) == "(3, 9, rows, cols) or (27, rows, cols) or (rows, cols, 27)"
    assert shapes(presets.opencv(), (64, 48)) == "(1260,) or (7, 5, 36)"
