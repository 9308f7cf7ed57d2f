"""The preset, and the precision, in which each stored output was made, from the parameters by the program's names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch

from nablahog.hog import HOGSpec, presets

from . import Case


def _opencv(p: dict[str, Any]) -> HOGSpec:
    sizes = (tuple(p[name]) for name in ("winSize_wh", "blockSize", "blockStride", "cellSize"))
    return presets.opencv(
        *sizes,
        p["nbins"],
        win_sigma=p["winSigma"],
        l2hys_threshold=p["L2HysThreshold"],
        gamma=p["gammaCorrection"],
        signed=p["signedGradient"],
    )


def _skimage(p: dict[str, Any]) -> HOGSpec:
    return presets.skimage(
        p["orientations"],
        tuple(p["pixels_per_cell"]),
        tuple(p["cells_per_block"]),
        p["block_norm"],
        transform_sqrt=p["transform_sqrt"],
        feature_vector=p["feature_vector"],
        channel_axis=p["channel_axis"],
    )


def _vlfeat(p: dict[str, Any]) -> HOGSpec:
    return presets.vlfeat(
        "uoctti" if p["variant"] == "uoctti" else "dalaltriggs",
        cell_size=p["cellSize"],
        orientations=p["numOrientations"],
        bilinear_orientations=p["bilinearOrientations"],
    )


_SPEC_OF: dict[str, Callable[[dict[str, Any]], HOGSpec]] = {
    "dlib": lambda p: presets.dlib(p["cell_size"]),
    "maskfeat": lambda p: presets.maskfeat(p["pool"], nbins=p["nbins"], gaussian_window=p["gaussian_window"]),
    "opencv": _opencv,
    "skimage": _skimage,
    "vlfeat": _vlfeat,
    "voc_dpm": lambda p: presets.dpm(p["sbin"]),
}


def spec_of(case: Case) -> HOGSpec:
    """The preset with the case's parameters."""
    return _SPEC_OF[case.peer](case.parameters)


def dtype_of(case: Case) -> torch.dtype:
    """The precision that the program works in."""
    return torch.float64 if case.peer == "skimage" else torch.float32


def stored(case: Case) -> torch.Tensor:
    """The stored output in the shape of ``layout="native"``: of OpenCV five axes are stored, of which it makes one."""
    output = torch.from_numpy(case.output)
    return output.flatten() if case.peer == "opencv" else output
