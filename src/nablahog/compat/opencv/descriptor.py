"""``cv2.HOGDescriptor`` of OpenCV 4, and the score of its detector with a derivative."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...hog import hog
from ...hog.spec import Angle
from ...inputs.tensors import advise_on_tensor
from ...runtime.pytorch import in_threads
from . import arguments
from .arguments import Locations, Size
from .multi_scale import Rectangles, Weights, clip, group_by_mean_shift, group_rectangles, pyramid_scales, resize
from .parameters import Parameters
from .windows import Padded, describe_windows, gradient_votes, place_windows, score_windows


class HOGDescriptor(Parameters):
    """``cv2.HOGDescriptor``, with its arguments, attributes and methods; positions and sizes are (x, y).

    Descriptors are the same up to about 1e-6, float32 rounding, and so are scores, with one exception: on processors
    with SSE2 or NEON, OpenCV uses the ``L2HysThreshold`` of the first descriptor that a process computes for all later
    ones; here each object has its own.

    Where OpenCV raises ``cv2.error``, this raises TypeError for an argument of another type, and ValueError for one out
    of range; also where OpenCV reads beyond its memory, as for images smaller than a window.

    ``derivAperture`` and ``histogramNormType`` are stored, and as in OpenCV do not change a descriptor.

    Args:
        _winSize: the first of the parameters below; or the name of a file to load all from, alone.

    Attributes:
        winSize: (width, height) of a window in pixels.
        blockSize: (width, height) of a block in pixels, whole cells.
        blockStride: pixels from one block to the next; divides the window less a block.
        cellSize: (width, height) of a cell in pixels.
        nbins: orientation bins over 180°, or over 360° if ``signedGradient``; 3 to 128, OpenCV's beyond are wrong.
        derivAperture: 1.
        winSigma: of the Gaussian over a block, pixels; a quarter of the mean of its sides if not above 0.
        histogramNormType: 0.
        L2HysThreshold: the clip.
        gammaCorrection: whether the square root of the image is taken first.  True in ``HOGDescriptor()``, else False
            by default.
        nlevels: the most levels of a pyramid.
        signedGradient: whether opposite gradients vote into different bins.
        svmDetector: coefficients of the linear detector, (n,) float32; an empty tuple without one, as in OpenCV.
        spec: the dialect of one window, for :func:`nablahog.hog`, which is differentiable.

    Raises:
        TypeError: some of the first five arguments are missing, or not of OpenCV's types.
        ValueError: sizes do not suit each other, or an argument is out of its range.

    Source: ``modules/objdetect/src/hog.cpp`` of OpenCV 4.

    >>> import numpy as np
    >>> from nablahog.compat.opencv import HOGDescriptor
    >>> descriptor = HOGDescriptor()  # instead of cv2.HOGDescriptor()
    >>> descriptor.getDescriptorSize()
    3780
    >>> image = np.arange(136 * 72, dtype=np.uint8).reshape(136, 72)
    >>> descriptor.compute(image).shape  # 2 x 2 windows of 64x128 (width x height), 8 pixels apart
    (15120,)
    >>> descriptor.setSVMDetector(np.ones(3781, np.float32))  # or descriptor.getDefaultPeopleDetector()
    >>> rectangles, weights = descriptor.detectMultiScale(image, winStride=(8, 8), scale=1.05, groupThreshold=0)
    >>> rectangles.shape, weights.shape
    ((5, 4), (5,))
    """

    def compute(
        self,
        img: NDArray[np.uint8],
        winStride: Sequence[int] | None = None,
        padding: Sequence[int] | None = None,
        locations: Locations | None = None,
    ) -> NDArray[np.float32]:
        """Descriptors of windows, one after another; not differentiable.

        Gradients are those of the whole image, padded by reflection at its outermost pixels (reflect-101).

        Args:
            img: (rows, cols), or (rows, cols, 1 or 3), uint8.
            winStride: pixels from one window to the next, the cell size if None or (0, 0).  Windows are in order row by
                row, from the upper left corner of the padded image.
            padding: pixels on each side of the image, 0 if negative.  It is rounded up to a multiple of the greatest
                common divisor of ``winStride`` and ``blockStride`` if that is a power of two, and otherwise to the
                number that OpenCV computes.
            locations: the upper left corners of windows, in pixels of the image, instead of a grid of windows.

        Returns:
            (windows * descriptor size,), float32.  Zeros for windows of ``locations`` beyond the padded image.

        Raises:
            TypeError: the image is not an array of uint8, or an argument is not of integers.
            ValueError: the image is of another shape, or smaller, with its padding, than a window.
        """
        padded, corners = place_windows(*self._check_arguments(img, winStride, padding, "locations", locations))
        if locations is None:  # all are in the image
            return describe_windows(padded, corners, self._scheme).reshape(-1)
        inside = padded.inside(corners, self.winSize)
        out = np.zeros((len(corners), self.getDescriptorSize()), np.float32)
        out[inside] = describe_windows(padded, corners[inside], self._scheme)
        return out.reshape(-1)

    def computeGradient(
        self,
        img: NDArray[np.uint8],
        grad: NDArray[np.float32] | None,
        angleOfs: NDArray[np.uint8] | None,
        paddingTL: Sequence[int] | None = None,
        paddingBR: Sequence[int] | None = None,
    ) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Votes of each pixel of the padded image, and the bins that they go to.

        Args:
            img: (rows, cols), or (rows, cols, 1 or 3), uint8.
            grad: an array that the first result is written to if it is of the result's shape and dtype; None for none.
            angleOfs: the same of the second result.
            paddingTL: (x, y) pixels on the left and at the top; negative numbers leave out pixels of the image.
            paddingBR: (x, y) pixels on the right and at the bottom; likewise.

        Returns:
            Votes (rows, cols, 2), float32: magnitude · (1 - f) and magnitude · f; and their bins, (rows, cols, 2),
            uint8.  ``cv2.UMat`` if one of the arguments is one.

        Raises:
            TypeError: the image is not an array of uint8, or a padding is not of integers.
            ValueError: the image is of another shape, no pixel of it is left, or an array cannot be written to.
        """
        before, left, top = arguments.margins("paddingTL", paddingTL)
        after, right, bottom = arguments.margins("paddingBR", paddingBR)
        padded = Padded(arguments.image(img), before, after)
        remaining = slice(top, max(padded.size[1] - bottom, 0)), slice(left, max(padded.size[0] - right, 0))
        votes, bins = (np.ascontiguousarray(pixels[remaining]) for pixels in gradient_votes(padded, self._scheme))
        if not votes.size:
            raise ValueError(f"paddingTL and paddingBR must leave pixels of the image, got {paddingTL} and {paddingBR}")
        umats: list[Any] = [type(array) for array in (img, grad, angleOfs) if arguments.is_umat(array)]
        if umats:
            votes, bins = umats[0](votes), umats[0](bins)
        return arguments.output("grad", grad, votes), arguments.output("angleOfs", angleOfs, bins)

    def _check_arguments(
        self, img: Any, step: Any, padding: Any, name: str, places: Locations | None
    ) -> tuple[NDArray[np.uint8], Size, Size, NDArray[np.int64] | None, Size, Size]:
        """The arguments of :func:`place_windows`."""
        around, corners = arguments.margins("padding", padding)[0], arguments.locations(name, places)
        step = arguments.stride(step, self.cellSize)
        return arguments.image(img), step, around, corners, self.winSize, self.blockStride

    def detect(
        self,
        img: NDArray[np.uint8],
        hitThreshold: float = 0,
        winStride: Sequence[int] | None = None,
        padding: Sequence[int] | None = None,
        searchLocations: Locations | None = None,
    ) -> tuple[NDArray[np.int32] | tuple[()], Weights | tuple[()]]:
        """Finds windows whose score is at least ``hitThreshold``; all are of the window's own size.

        Args:
            img: (rows, cols), or (rows, cols, 1 or 3), uint8.
            hitThreshold: the least score.
            winStride: pixels from one window to the next, the cell size if None or (0, 0).
            padding: as in :meth:`compute`.
            searchLocations: the upper left corners of windows, in pixels of the image, instead of a grid of windows.

        Returns:
            Upper left corners (N, 2), int32, in pixels of the image, and scores (N,), float64; two empty tuples for
            none, as in OpenCV, or if there is no detector.

        Raises:
            TypeError: the image is not an array of uint8, or an argument is of another type.
            ValueError: the image is of another shape, or smaller, with its padding, than a window.
        """
        threshold = arguments.number("hitThreshold", hitThreshold, 0)
        checked = self._check_arguments(img, winStride, padding, "searchLocations", searchLocations)
        if not len(self._detector):
            return (), ()
        places, weights = self._find_hits(*place_windows(*checked), threshold)
        return (places.astype(np.int32), weights) if len(places) else ((), ())

    def _find_hits(
        self, padded: Padded, corners: NDArray[np.int64], threshold: float
    ) -> tuple[NDArray[np.int64], Weights]:
        """Corners in pixels of the image, and scores."""
        corners = corners[padded.inside(corners, self.winSize)]
        weights = score_windows(padded, corners, self._scheme, np.asarray(self._detector))
        hits = weights >= threshold
        return corners[hits] - padded.before, weights[hits]

    def detectMultiScale(
        self,
        img: NDArray[np.uint8],
        hitThreshold: float = 0,
        winStride: Sequence[int] | None = None,
        padding: Sequence[int] | None = None,
        scale: float = 1.05,
        groupThreshold: float = 2.0,
        useMeanshiftGrouping: bool = False,
    ) -> tuple[Rectangles | tuple[()], Weights | tuple[()]]:
        """Finds objects of all sizes: windows in an image that is made smaller step by step, those that overlap as one.

        Levels are shared out to as many threads as PyTorch takes; the result does not depend on their number.

        Args:
            img: (rows, cols), or (rows, cols, 1 or 3), uint8.
            hitThreshold: the least score.
            winStride: pixels from one window to the next, at each level; the block stride if None or (0, 0).
            padding: of each level, as in :meth:`compute`.
            scale: from one level to the next; one level if it is not above 1.
            groupThreshold: a class of overlapping windows must have more members; 0 does not group.  With the mean
                shift, the least density.
            useMeanshiftGrouping: whether to return the modes of the density of windows instead.

        Returns:
            Rectangles (N, 4), int32, x, y, width and height within the image, and weights (N,), float64: the largest
            score, or the density; two empty tuples for none, as in OpenCV, or if there is no detector.

        Raises:
            TypeError: the image is not an array of uint8, or an argument is of another type.
            ValueError: the image is of another shape, or smaller, with its padding, than a window.
        """
        pixels, step = arguments.image(img), arguments.stride(winStride, self.blockStride)
        threshold, around = arguments.number("hitThreshold", hitThreshold, 0), arguments.margins("padding", padding)[0]
        group, factor = arguments.number("groupThreshold", groupThreshold, 2), arguments.number("scale", scale, 1.05)
        mean_shift = arguments.flag("useMeanshiftGrouping", useMeanshiftGrouping)
        if not mean_shift and not abs(group) < 2**31:
            raise ValueError(f"groupThreshold must be a number of 32 bits, got {group}")
        if not len(self._detector):
            return (), ()
        size = pixels.shape[1], pixels.shape[0]
        scales = pyramid_scales(size, self.winSize, factor, self.nlevels)

        def level(k: int) -> tuple[Rectangles, Weights]:
            smaller = resize(pixels, (round(size[0] / scales[k]), round(size[1] / scales[k])))
            padded, corners = place_windows(smaller, step, around, None, self.winSize, self.blockStride)
            places, weights = self._find_hits(padded, corners, threshold)
            sides = np.broadcast_to(self.winSize, places.shape)
            return np.rint(np.hstack([places, sides]) * scales[k]).astype(np.int32), weights

        found = in_threads(level, len(scales))
        rectangles, weights = (np.concatenate(parts) for parts in zip(*found, strict=True))
        if not len(rectangles):
            return (), ()
        if mean_shift:
            hit_scales = np.repeat(scales, [len(hits) for hits, _ in found])
            rectangles, weights = group_by_mean_shift(rectangles, weights, hit_scales, group, self.winSize)
        else:
            rectangles, weights = group_rectangles(rectangles, weights, int(group))
        rectangles, weights = clip(rectangles, weights, size)
        return (rectangles, weights) if len(rectangles) else ((), ())


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
        TypeError: the images are not a tensor of these dtypes.
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
        write = advise_on_tensor("images", images)
        raise TypeError(f"images must be a torch tensor (B, C, H, W), got {type(images).__name__}{write}")
    width, height = descriptor.winSize
    if images.shape[2:] != (height, width):
        raise ValueError(f"images must be (B, C, {height}, {width}), windows of the descriptor, got {(*images.shape,)}")
    if not len(descriptor.svmDetector):
        raise ValueError("the descriptor has no detector: call its setSVMDetector first")
    described = hog(images, replace(descriptor.spec, angle=angle), layout="native")
    coefficients = torch.from_numpy(np.asarray(descriptor.svmDetector)).to(described)
    size = described.shape[1]
    with torch.autocast(images.device.type, enabled=False):  # scores in half precision would not be those of detect
        return described @ coefficients[:size] + coefficients[size:].sum()
