"""A result as it is shown."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
import PIL.Image
import torch

from nablahog import hog, presets, reconstruct
from nablahog.invert import Search


def test_a_result_shows_its_figures_and_in_a_notebook_its_images() -> None:
    descriptor = hog(torch.rand(5, 1, 16, 16), presets.uoctti())
    few = Search(max_evaluations=5)
    result = reconstruct(descriptor, "uoctti", search=few)
    assert re.fullmatch(
        r"<Reconstruction image 5x1x16x16, distance ([\d.e-]+, ){4}…, [\w ,]+, \d+\.\d s>", repr(result)
    )
    shown = result._repr_html_()
    assert shown.count("<img ") == 4
    assert "&lt;Reconstruction image 5x1x16x16" in shown
    png = base64.b64decode(shown.split("base64,")[1].split('"')[0])
    np.testing.assert_array_equal(
        np.asarray(PIL.Image.open(io.BytesIO(png))), (255 * result.image[0, 0]).round().byte().numpy()
    )
    array = reconstruct(descriptor[0].numpy(), "uoctti", search=few)
    assert repr(array).startswith("<Reconstruction image 16x16, distance ")
    assert array._repr_html_().count("<img ") == 1
