"""Weights of linear detectors, in DPM models, files of OpenCV and arrays."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from ..hog import HOGSpec, presets
from ..hog.layout import from_layout
from ..io.arrays import is_raw, naming, read_array, refuse_pickle
from ..io.descriptor_file import FittedLayout
from ..io.dpm_file import is_dpm_file, load_dpm
from ..io.input_file import InputFile, Readable, input_file
from .arrays import fit_array, suggesting
from .inversion import GlyphRequest
from .sources import Source

# width x height of the windows of OpenCV's people detectors, by the number of their weights
OPENCV_WINDOWS = {3780: "64x128", 1980: "48x96"}
OPENCV_ENDINGS = (".yml", ".yaml", ".xml", ".json")  # of what cv2.HOGDescriptor.save writes, perhaps with .gz


def read_templates(path: Readable, request: GlyphRequest) -> list[Source]:
    """The templates in a file: weights in place of descriptors; of several, ``part`` says which one it is.

    It is a model of voc-release5 (.mat), a HOGDescriptor that OpenCV saved with its detector (.yml, .xml, .json, also
    .gz), or an array of weights (.npy, .npz, .mat) in the layout of its library; a bias after the weights is ignored.
    OpenCV's people detectors are recognised by their length.
    """
    file = input_file(path)
    file.check("the weights of a detector")
    if is_opencv_file(file):
        return [_from_opencv(file)]
    refuse_pickle(file)
    if not is_raw(file):
        raise ValueError(
            f"{file}: expected a model of voc-release5 (.mat), a HOGDescriptor that OpenCV saved (.yml, .xml, .json), "
            "or an array of weights (.npy, .npz, .mat); save the weights of a dlib detector as one"
        )
    if is_dpm_file(file):
        model = load_dpm(file)
        spec = presets.dpm(model.cell_size)
        return [
            Source(file.name, "", part.weights, spec, spec.image_size(*part.weights.shape[:2]), None, part.name)
            for part in model.filters
        ]
    array = read_array(file, request.key)
    with naming(file), suggesting(array, request):
        if not np.isfinite(array).all():
            raise ValueError("the weights must be finite, got NaN or Inf")
        return [_from_array(file.name, array, request)]


def is_opencv_file(file: InputFile) -> bool:
    """Whether the name is that of a file which ``cv2.HOGDescriptor.save`` writes."""
    return file.name.lower().removesuffix(".gz").endswith(OPENCV_ENDINGS)


def _from_opencv(file: InputFile) -> Source:
    from ..compat.opencv import HOGDescriptor

    hog = HOGDescriptor()
    hog.load(file)
    if not len(hog.svmDetector):
        raise ValueError(f"{file}: expected a HOGDescriptor with the coefficients of its detector, got none")
    width, height = hog.winSize
    descriptor = from_layout(
        torch.from_numpy(hog.svmDetector[: hog.getDescriptorSize()])[None], hog.spec, (height, width)
    )
    return Source(file.name, "", descriptor[0].contiguous(), hog.spec, (height, width), None)


def _from_array(path: str, array: NDArray[np.floating], request: GlyphRequest) -> Source:
    if array.size == max(array.shape, default=0):
        array = array.reshape(-1)
    spec, how = _fit(array.shape, request)
    weights = torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))
    if math.prod(how.shape) < array.size:  # a bias follows
        weights = weights[:-1]
    native = weights.reshape(1, *how.shape)
    descriptor = from_layout(native, replace(spec, layout=how.layout), how.image_size)[0].contiguous()
    return Source(path, "", descriptor, spec, how.image_size, None)


def _fit(shape: tuple[int, ...], request: GlyphRequest) -> tuple[HOGSpec, FittedLayout]:
    lengths = (shape[0], shape[0] - 1) if len(shape) == 1 else ()
    if request.preset is None:
        for length in lengths:
            if length in OPENCV_WINDOWS:
                window = GlyphRequest(preset="opencv", settings={"win_size": OPENCV_WINDOWS[length]})
                return fit_array((length,), window)
    try:
        return fit_array(shape, request)
    except ValueError:
        if lengths:
            with suppress(ValueError):
                return fit_array((lengths[1],), request)
        raise
