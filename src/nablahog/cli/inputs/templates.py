"""The option ``--template``: weights of linear detectors, in DPM models and arrays."""

from __future__ import annotations

import math
from argparse import Namespace
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...hog import HOGSpec, presets
from ...hog.layout import from_layout
from ...invert import template_descriptor
from ...io.arrays import is_raw, read_array
from ...io.dpm_file import is_dpm_file, load_dpm
from ...io.files import distinct_stems
from ...io.layouts import Fit, fit
from ...io.npz import naming
from ..errors import as_user_error
from .arrays import ArrayOptions
from .expand import expand
from .sources import Inputs, Source
from .spec import SpecOptions

# (width, height) of the windows of OpenCV's people detectors, by the number of their weights
OPENCV_WINDOWS = {3780: (64, 128), 1980: (48, 96)}
SIGNS = {"positive": 1, "negative": -1}


@dataclass(frozen=True)
class DetectorTemplate:
    """Weights of a score over descriptors.

    Attributes:
        name: which one of its file, for captions; empty if it is the only one.
        weights: (rows, cols, channels), float32.
        spec: of the descriptors.
        image_size: (height, width) in pixels of what they describe.
    """

    name: str
    weights: Tensor
    spec: HOGSpec
    image_size: tuple[int, int]


def read_template_inputs(arguments: Namespace) -> Inputs:
    """The templates in the ``inputs`` of a command, each as two sources: its weights, and their negatives.

    Raises:
        UserError: an option is wrong, or no input can be used.
    """
    with as_user_error():
        spec_options, array_options = SpecOptions.of(arguments), ArrayOptions.of(arguments)
    expanded = expand(arguments, (".mat", ".npy", ".npz"))
    stems = distinct_stems([Path(path) for path in expanded.paths])
    sources: list[Source] = []
    for path, stem in zip(expanded.paths, stems, strict=True):
        with expanded.skipping.each(path):
            templates = read_templates(path, spec_options, array_options)
            sources += [
                _source(path, f"{stem}_{number}" if each.name else stem, each, sign)
                for number, each in enumerate(templates, start=1)
                for sign in SIGNS
            ]
    expanded.skipping.check()
    return Inputs(sources, expanded.skipping, expanded.paths, many=True)


def _source(path: str, stem: str, template: DetectorTemplate, sign: str) -> Source:
    """Raises ValueError if the template has no weights of this sign."""
    weights = SIGNS[sign] * template.weights
    template_descriptor(weights[None], template.spec, template.image_size)
    part = f"{template.name}, {sign} weights" if template.name else f"{sign} weights"
    return Source(path, f"{stem}_{sign}", weights, template.spec, template.image_size, None, part)


def read_templates(path: str, spec_options: SpecOptions, array_options: ArrayOptions) -> list[DetectorTemplate]:
    """The templates in a file.

    Args:
        path: a model of voc-release5 (.mat), or an array of weights (.npy, .npz, .mat), in the layout of its library,
            with or without a bias after them, which is ignored.
        spec_options: the spec of an array; OpenCV's people detectors are recognised by their length.
        array_options: image size and name of an array.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it holds no template, or one that does not fit the spec.
    """
    if not is_raw(path):
        raise ValueError(
            f"{path}: expected a model of voc-release5 (.mat) or an array of weights (.npy, .npz, .mat); of a dlib "
            "detector, save its weights as one"
        )
    if is_dpm_file(path):
        model = load_dpm(path)
        spec = presets.dpm(model.cell_size)
        return [
            DetectorTemplate(each.name, each.weights, spec, spec.image_size(*each.weights.shape[:2]))
            for each in model.filters
        ]
    array = read_array(path, array_options.key)
    with naming(path):
        return [_of_array(array, spec_options, array_options)]


def _of_array(array: NDArray[np.floating], spec_options: SpecOptions, array_options: ArrayOptions) -> DetectorTemplate:
    if array.size == max(array.shape, default=0):
        array = array.reshape(-1)
    spec, how = _fit(array.shape, spec_options, array_options)
    weights = torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))
    if math.prod(how.shape) < array.size:  # a bias follows
        weights = weights[:-1]
    native = weights.reshape(1, *how.shape)
    descriptor = from_layout(native, replace(spec, layout=how.layout), how.image_size)[0].contiguous()
    return DetectorTemplate("", descriptor, spec, how.image_size)


def _fit(shape: tuple[int, ...], spec_options: SpecOptions, array_options: ArrayOptions) -> tuple[HOGSpec, Fit]:
    lengths = (shape[0], shape[0] - 1) if len(shape) == 1 else ()
    if spec_options.preset is None:
        for length in lengths:
            if length in OPENCV_WINDOWS:
                window = OPENCV_WINDOWS[length]
                how = fit((length,), spec := presets.opencv(window), (window[1], window[0]))
                assert how is not None
                return spec, how
    try:
        return array_options.fitting(shape, spec_options)
    except ValueError:
        if lengths:
            with suppress(ValueError):
                return array_options.fitting((lengths[1],), spec_options)
        raise
