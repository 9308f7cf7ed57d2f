"""The score of a linear detector as a function of the image, with its derivative."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from ...hog import hog
from ...hog.spec import Angle
from .descriptor import HOGDescriptor


def score(images: Tensor, descriptor: HOGDescriptor, angle: Angle = "opencv") -> Tensor:
    """The score of windows by the detector of a descriptor: what ``detect`` calls their weights; differentiable.

    Args:
        images: (B, 1 or 3, height, width) of ``descriptor.winSize``, float32 or float64 in 0…1, or uint8; any device.
        descriptor: with a detector.
        angle: of gradients.  ``"opencv"``: its polynomial, for its scores; the derivative is that of the exact angle,
            from which the polynomial is less than 3e-4 rad away.  ``"exact"``: of value and derivative.

    Returns:
        (B,), float64 for images of float64, else float32.

    Raises:
        TypeError: the images are no tensor of these dtypes.
        ValueError: the descriptor has no detector, or images are of another size.

    >>> from nablahog.compat.opencv import HOGDescriptor, score
    >>> descriptor = HOGDescriptor()
    >>> descriptor.setSVMDetector(np.ones(3781))  # or descriptor.getDefaultPeopleDetector()
    >>> windows = torch.rand(2, 3, 128, 64, requires_grad=True)
    >>> score(windows, descriptor).sum().backward()
    >>> windows.grad.shape
    torch.Size([2, 3, 128, 64])
    """
    if not isinstance(images, Tensor):
        raise TypeError(f"images must be a torch tensor (B, C, H, W), got {type(images).__name__}")
    width, height = descriptor.winSize
    if images.shape[2:] != (height, width):
        raise ValueError(f"images must be (B, C, {height}, {width}), windows of the descriptor, got {(*images.shape,)}")
    if not len(descriptor.svmDetector):
        raise ValueError("the descriptor has no detector: call its setSVMDetector first")
    described = hog(images, replace(descriptor.spec, angle=angle), layout="native")
    coefficients = torch.from_numpy(np.asarray(descriptor.svmDetector)).to(described)
    size = described.shape[1]
    return described @ coefficients[:size] + coefficients[size:].sum()
