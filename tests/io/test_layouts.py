"""Arrays of other libraries: every layout is recognised and converted back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

import nablahog
from nablahog import presets
from nablahog.cli.arguments.presets import PRESETS, make_spec
from nablahog.hog import HOGSpec
from nablahog.io.layouts import Fit, fit, stored

SIZE = (40, 64)
VARIANTS: dict[str, HOGSpec] = {
    **{name: make_spec(name, {}) for name in PRESETS},
    "skimage-blocks": presets.skimage(cells_per_block=(2, 3), feature_vector=False),
    "vlfeat-dalaltriggs": presets.vlfeat("dalaltriggs"),
    "opencv-stride": presets.opencv((64, 48), (24, 16), (4, 8), (12, 8), 5),
}


def _native(spec: HOGSpec, size: tuple[int, int] = SIZE) -> tuple[NDArray[Any], torch.Tensor]:
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
            for size in (SIZE, None) if array.ndim > 1 else (SIZE,):
                how = fit(batched.shape, spec, size)
                assert how is not None
                assert how.image_size == (size or (height, width))
                result = stored(batched, spec, how)
                assert (result.spec, result.image_size) == (spec, how.image_size)
                assert torch.equal(result.descriptor, descriptor)


def test_layouts_that_libraries_have_besides() -> None:
    for spec in (presets.skimage(), presets.skimage(feature_vector=False)):
        _, descriptor = _native(spec)
        for shape in ((3, 6, 3, 3, 9), (3, 6, 81), (1, 1458)):
            how = fit(shape, spec, SIZE)
            assert how is not None
            assert torch.equal(stored(descriptor.numpy().reshape(shape), spec, how).descriptor, descriptor)
    spec = presets.maskfeat()
    native, descriptor = _native(spec)
    how = fit((27, 5, 8), spec, None)
    assert how == Fit("planes", (27, 5, 8), SIZE)
    assert torch.equal(stored(native.reshape(27, 5, 8), spec, how).descriptor, descriptor)
    assert fit((3780, 1), presets.opencv(), (128, 64)) == Fit("opencv-vector", (3780,), (128, 64))  # of older versions
