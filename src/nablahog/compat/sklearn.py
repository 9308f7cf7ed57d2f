"""HOG as a step of a scikit-learn pipeline.  Needs scikit-learn, which the package itself does not."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from ..hog import presets
from ..hog.descriptor import hog
from ..hog.dialects import as_spec
from ..hog.spec import HOGSpec
from ..inputs.arrays import as_array
from ..inputs.batches import as_batch
from ..inputs.numbers import as_size
from ..runtime.text import did_you_mean

__all__ = ["HOGTransformer"]

_OWN = ("spec", "image_size", "layout")


class HOGTransformer(TransformerMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """A scikit-learn transformer: images to rows of HOG features.  It learns nothing but the shape of the images.

    Args:
        spec: the dialect, or the name of a preset.
        image_size: (height, width) of the images that are rows of a table, as scikit-learn's own data sets have them,
            gray or with the colours R, G, B of each pixel side by side; None for batches of images.
        layout: ``"cells"`` or ``"native"``, the order of the features of an image.
        **parameters: of the preset, such as ``pixels_per_cell=(4, 4)`` with ``"skimage"``; a grid search can vary them.

    Attributes:
        image_shape_: (height, width, channels) of the images in ``fit``, which those in ``transform`` must have, too.
        n_features_out_: the number of features of an image.

    Raises:
        TypeError, ValueError: by its methods, if their input is no batch of images of one size, or not of
            ``image_size``, or of another shape than in ``fit``, or not finite; or if the preset does not have the
            parameters.

    >>> from nablahog.compat.sklearn import HOGTransformer
    >>> images = np.zeros((2, 32, 32, 3), np.uint8)
    >>> HOGTransformer("uoctti").fit_transform(images).shape
    (2, 496)
    >>> rows = np.zeros((2, 32 * 32))
    >>> HOGTransformer("uoctti", image_size=(32, 32)).fit_transform(rows).shape
    (2, 496)
    >>> HOGTransformer("skimage", pixels_per_cell=(16, 16), cells_per_block=(1, 1)).fit_transform(images).shape
    (2, 36)
    """

    def __init__(
        self,
        spec: HOGSpec | str = "uoctti",
        *,
        image_size: tuple[int, int] | None = None,
        layout: str = "cells",
        **parameters: Any,
    ) -> None:
        self.spec = spec
        self.image_size = image_size
        self.layout = layout
        for name, value in parameters.items():
            setattr(self, name, value)

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The arguments, with those parameters of the preset that have been given."""
        return {**super().get_params(deep), **self._parameters()}

    def set_params(self, **params: Any) -> HOGTransformer:
        """Sets arguments, and parameters of the preset; with another ``spec``, those of the one before are forgotten.

        Raises:
            ValueError: the preset has no such parameter.
        """
        if "spec" in params:
            for name in self._parameters():
                delattr(self, name)
        super().set_params(**{name: value for name, value in params.items() if name in _OWN})
        parameters = {name: value for name, value in params.items() if name not in _OWN}
        self._check_parameters(parameters)
        for name, value in parameters.items():
            setattr(self, name, value)
        return self

    def _parameters(self) -> dict[str, Any]:
        """The parameters of the preset that have been given; other attributes begin or end with an underscore."""
        names = [name for name in vars(self) if name not in _OWN and not name.startswith("_") and name[-1] != "_"]
        return {name: getattr(self, name) for name in names}

    def _check_parameters(self, parameters: dict[str, Any]) -> None:
        """Raises ValueError if the preset has not all of these parameters."""
        if not parameters:
            return
        if not isinstance(self.spec, str):
            raise ValueError(
                f"expected the name of a preset with {', '.join(parameters)}, got a spec, which has its own"
            )
        as_spec(self.spec)
        known = inspect.signature(getattr(presets, self.spec)).parameters
        for name in parameters:
            if name not in known:
                meant = did_you_mean(name, known)
                raise ValueError(f"{self.spec} has no parameter {name!r}; it has {', '.join(known)}{meant}")

    def fit(self, X: ArrayLike, y: object = None) -> HOGTransformer:
        """Checks the images (N, H, W) or (N, H, W, C), C 1 or 3, or with an ``image_size``, (N, H · W · C).

        They may be a list, also of PIL images and tensors.  ``y`` does not count.
        """
        images = self._images(X)
        validate_data(self, images if self.image_size is None else X, reset=True, skip_check_array=True)
        self.image_shape_ = images.shape[1:]
        self.n_features_out_ = self._described(images[:1]).shape[1]
        return self

    def transform(self, X: ArrayLike) -> NDArray[Any]:
        """The descriptors (N, features) of images of the shape of those in ``fit``.

        In float32 for images in float32, the default dtype of PyTorch for uint8, and float64 for other floats.
        """
        check_is_fitted(self)
        images = self._images(X)
        if self.image_size is not None:
            validate_data(self, X, reset=False, skip_check_array=True)  # names and number of columns
        if images.shape[1:] != self.image_shape_:
            height, width, channels = self.image_shape_
            raise ValueError(
                f"X has images of shape {images.shape[1:]}, but HOGTransformer is expecting {self.image_shape_} as in "
                f"fit: write image.convert('{'L' if channels == 1 else 'RGB'}').resize(({width}, {height})) of each as "
                "a PIL image, or fit again"
            )
        return self._described(images)

    def get_feature_names_out(self, input_features: object = None) -> NDArray[np.object_]:
        """``hog0``, ``hog1`` and so on."""
        check_is_fitted(self)
        return np.array([f"hog{k}" for k in range(self.n_features_out_)], dtype=object)

    def _images(self, X: ArrayLike) -> NDArray[Any]:
        """(N, H, W, C)"""
        if self.image_size is None:
            return as_batch("X", X)
        (height, width), rows = as_size("image_size", self.image_size), as_array("X", X)
        if rows.ndim != 2 or rows.shape[1] not in (height * width, 3 * height * width):
            raise ValueError(
                f"X must be rows of images of {height}x{width} pixels, 1 or 3 numbers a pixel, got {rows.shape}: leave "
                "image_size out for batches of images"
            )
        return as_batch("X", rows.reshape(len(rows), height, width, -1))

    def _described(self, images: NDArray[Any]) -> NDArray[Any]:
        layout: Any = self.layout
        parameters = self._parameters()
        self._check_parameters(parameters)
        spec = getattr(presets, str(self.spec))(**parameters) if parameters else as_spec(self.spec)
        return hog(images, spec, layout=layout).reshape(len(images), -1)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.three_d_array = self.image_size is None
        tags.input_tags.two_d_array = self.image_size is not None
        tags.transformer_tags.preserves_dtype = ["float32", "float64"]
        return tags


def __dir__() -> list[str]:
    return __all__
