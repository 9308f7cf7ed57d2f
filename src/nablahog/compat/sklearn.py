"""HOG as a step of a scikit-learn pipeline.  Needs scikit-learn, which the package itself does not."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from ..hog.descriptor import hog
from ..hog.dialects import as_spec
from ..hog.spec import HOGSpec
from ..inputs.arrays import check_unmasked
from ..inputs.numbers import as_size
from ..inputs.pil_images import is_pil, pil_pixels

__all__ = ["HOGTransformer"]


class HOGTransformer(TransformerMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """A scikit-learn transformer: images to rows of HOG features.  It learns nothing but the number of features.

    Args:
        spec: the dialect, or the name of a preset with its defaults.
        image_size: (height, width) of the images that are rows of a table, as scikit-learn's own data sets have them,
            gray or with the colours R, G, B of each pixel side by side; None for batches of images.
        layout: ``"cells"`` or ``"native"``, the order of the features of an image.

    Raises:
        TypeError, ValueError: by its methods, if their input is no batch of images, or not of ``image_size``.

    >>> from nablahog.compat.sklearn import HOGTransformer
    >>> images = np.zeros((2, 32, 32, 3), np.uint8)
    >>> HOGTransformer("uoctti").fit_transform(images).shape
    (2, 496)
    >>> rows = np.zeros((2, 32 * 32))
    >>> HOGTransformer("uoctti", image_size=(32, 32)).fit_transform(rows).shape
    (2, 496)
    """

    def __init__(
        self, spec: HOGSpec | str = "uoctti", *, image_size: tuple[int, int] | None = None, layout: str = "cells"
    ) -> None:
        self.spec = spec
        self.image_size = image_size
        self.layout = layout

    def fit(self, X: ArrayLike, y: object = None) -> HOGTransformer:
        """Checks the images (N, H, W), (N, H, W, C) or, with an ``image_size``, (N, H · W · C), C 1 or 3.

        ``y`` does not count.
        """
        self.n_features_out_ = self._described(self._images(X, reset=True)[:1]).shape[1]
        return self

    def transform(self, X: ArrayLike) -> NDArray[Any]:
        """The descriptors (N, features), of the dtype of the images (the default dtype of PyTorch for uint8)."""
        check_is_fitted(self)
        return self._described(self._images(X, reset=False))

    def get_feature_names_out(self, input_features: object = None) -> NDArray[np.object_]:
        """``hog0``, ``hog1`` and so on."""
        check_is_fitted(self)
        return np.array([f"hog{k}" for k in range(self.n_features_out_)], dtype=object)

    def _images(self, X: ArrayLike, reset: bool) -> NDArray[Any]:
        if is_pil(X):
            raise TypeError("X must be a batch of images, got a PIL image: write [image]")
        if isinstance(X, list | tuple):  # scikit-learn makes floats of them
            X = np.asarray([pil_pixels("X", x) if is_pil(x) else x for x in X])
        check_unmasked("X", X)
        if getattr(getattr(X, "dtype", None), "kind", "f") in ("U", "S"):
            raise TypeError("X must hold real numbers, got strings: write X.astype(float)")
        numbers = [np.float64, np.float32, np.uint8]  # the first for all others
        values: NDArray[Any] = validate_data(self, X, dtype=numbers, allow_nd=self.image_size is None, reset=reset)
        return self._arranged(values)

    def _arranged(self, values: NDArray[Any]) -> NDArray[Any]:
        """Numbers as they were passed, as images (N, H, W, C)."""
        if self.image_size is None:
            if values.ndim not in (3, 4):
                raise ValueError(
                    f"images must be (N, H, W) or (N, H, W, C), or rows with an image_size, got {values.shape}"
                )
            return values if values.ndim == 4 else values[..., None]
        (height, width), (count, features) = as_size("image_size", self.image_size), values.shape
        if features not in (height * width, 3 * height * width):
            raise ValueError(
                f"rows of images of {height}x{width} pixels must have 1 or 3 numbers a pixel, got {features} numbers"
            )
        return values.reshape(count, height, width, -1)

    def _described(self, images: NDArray[Any]) -> NDArray[Any]:
        layout: Any = self.layout
        return hog(images, as_spec(self.spec), layout=layout).reshape(len(images), -1)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.three_d_array = self.image_size is None
        tags.input_tags.two_d_array = self.image_size is not None
        tags.transformer_tags.preserves_dtype = ["float32", "float64"]
        return tags


def __dir__() -> list[str]:
    return __all__
