"""HOG as a step of a scikit-learn pipeline, by scikit-learn's own checks."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

pytest.importorskip("sklearn")

from PIL import Image
from sklearn.base import clone
from sklearn.datasets import load_digits
from sklearn.pipeline import make_pipeline
from sklearn.svm import LinearSVC
from sklearn.utils.estimator_checks import check_estimator

from nablahog import hog, presets
from nablahog.compat.sklearn import HOGTransformer


@pytest.mark.filterwarnings("ignore")  # of numbers beyond 0…1
def test_it_passes_the_checks_of_estimators() -> None:
    check_estimator(HOGTransformer())


@pytest.mark.parametrize("layout", ["cells", "native"])
@pytest.mark.parametrize("spec", ["uoctti", presets.vlfeat(cell_size=4)])
def test_rows_are_descriptors(spec: Any, layout: str) -> None:
    images = np.random.default_rng(0).random((3, 16, 24, 3))
    expected = hog(images, spec, layout=layout).reshape(3, -1)  # type: ignore[call-overload]
    transformer = HOGTransformer(spec, layout=layout).fit(images)
    np.testing.assert_array_equal(transformer.transform(images), expected)
    rows = HOGTransformer(spec, image_size=(16, 24), layout=layout)
    np.testing.assert_array_equal(rows.fit_transform(images.reshape(3, -1)), expected)
    gray = HOGTransformer(spec, layout=layout).fit_transform(images[..., 0])
    np.testing.assert_array_equal(gray, hog(images[..., :1], spec, layout=layout).reshape(3, -1))  # type: ignore[call-overload]
    assert list(transformer.get_feature_names_out()[:2]) == ["hog0", "hog1"]
    assert len(transformer.get_feature_names_out()) == expected.shape[1]
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(transformer)).transform(images), expected)


def test_digits_are_recognised() -> None:
    """Four cells of HOG leave more of a digit of 8x8 pixels than chance, by far."""
    digits, names = load_digits(return_X_y=True)
    spec = presets.uoctti(4)
    pipeline = make_pipeline(HOGTransformer(spec, image_size=(8, 8)), LinearSVC(random_state=0))
    assert clone(pipeline).fit(digits[:400] / 16, names[:400]).score(digits[400:600] / 16, names[400:600]) > 0.7


def test_other_images_are_refused() -> None:
    with pytest.raises(ValueError, match=r"^images must be \(N, H, W\) or \(N, H, W, C\), or rows with an image_size"):
        HOGTransformer().fit(np.zeros((3, 16)))
    with pytest.raises(ValueError, match=r"^rows of images of 8x8 pixels .*, got 63 numbers$"):
        HOGTransformer(image_size=(8, 8)).fit(np.zeros((2, 63)))


def test_lists_are_described_as_their_images() -> None:
    images = (np.random.default_rng(0).random((2, 24, 32, 3)) * 255).astype(np.uint8)
    expected = HOGTransformer().fit_transform(images)
    np.testing.assert_array_equal(HOGTransformer().fit_transform(list(images)), expected)
    np.testing.assert_array_equal(HOGTransformer().fit_transform([Image.fromarray(x) for x in images]), expected)
    with pytest.raises(ValueError, match="masks some"):
        HOGTransformer().fit(np.ma.masked_equal(images, images.max()))
