"""HOG as a step of a scikit-learn pipeline, by scikit-learn's own checks."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("sklearn")

from PIL import Image
from sklearn.base import clone
from sklearn.datasets import load_digits
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.svm import LinearSVC
from sklearn.utils import get_tags
from sklearn.utils.estimator_checks import check_estimator

from nablahog import hog, presets
from nablahog.compat.sklearn import HOGTransformer


@pytest.mark.filterwarnings("ignore")  # of numbers beyond 0…1
def test_it_passes_the_checks_of_estimators() -> None:
    check_estimator(HOGTransformer())


@pytest.mark.parametrize("image_size", [None, (8, 8)])
def test_tags_say_whether_it_takes_images_or_rows(image_size: Any) -> None:
    tags = get_tags(HOGTransformer(image_size=image_size)).input_tags
    assert (tags.three_d_array, tags.two_d_array) == (image_size is None, image_size is not None)


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


def test_a_grid_search_varies_parameters_of_presets() -> None:
    """Cells of a digit of 8x8 pixels that leave nothing of its shape are not the best ones."""
    digits, names = load_digits(return_X_y=True)
    pipeline = make_pipeline(HOGTransformer("skimage", image_size=(8, 8)), LinearSVC(random_state=0))
    grid = [
        {
            "hogtransformer__pixels_per_cell": [(8, 8), (4, 4)],
            "hogtransformer__cells_per_block": [(1, 1)],
        },
        {"hogtransformer__spec": ["uoctti"], "hogtransformer__cell_size": [8, 4]},
    ]
    search = GridSearchCV(pipeline, grid, cv=2).fit(digits[:200] / 16, names[:200])
    scores = search.cv_results_["mean_test_score"]
    assert scores[1] > scores[0] + 0.1
    assert scores[3] > scores[2] + 0.1
    assert np.isfinite(scores).all()


@pytest.mark.filterwarnings("ignore")  # of numbers beyond 0…1
def test_parameters_of_presets() -> None:
    chosen = HOGTransformer("skimage", pixels_per_cell=(4, 8), orientations=6)
    check_estimator(HOGTransformer("uoctti", cell_size=4))
    assert chosen.get_params()["pixels_per_cell"] == (4, 8)
    assert clone(chosen).get_params() == chosen.get_params()
    assert "pixels_per_cell=(4, 8)" in repr(chosen)
    spec = presets.skimage(pixels_per_cell=(4, 8), orientations=6)
    expected = hog(IMAGES, spec).reshape(2, -1)  # type: ignore[call-overload]
    np.testing.assert_array_equal(clone(chosen).fit_transform(IMAGES), expected)
    assert set(clone(chosen).set_params(spec="uoctti", cell_size=4).get_params()) == {
        *("spec", "image_size", "layout", "cell_size")
    }
    with pytest.raises(ValueError, match="did you mean 'pixels_per_cell'"):
        HOGTransformer("skimage", pixel_per_cell=(4, 4)).fit(IMAGES)
    with pytest.raises(ValueError, match="skimage has no parameter 'cell_size'"):
        chosen.set_params(cell_size=4)
    with pytest.raises(ValueError, match="the name of a preset"):
        HOGTransformer(presets.uoctti(), cell_size=4).fit(IMAGES)


IMAGES = (np.random.default_rng(0).random((2, 24, 32, 3)) * 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("image_size", "images", "words"),
    [
        (None, np.zeros((3, 16)), r"got \(3, 16\): write array.reshape\(-1, height, width\)"),
        ((8, 8), np.zeros((2, 63)), r"^X must be rows of images of 8x8 pixels, .*, got \(2, 63\)"),
        (None, [IMAGES[0], IMAGES[1, :16]], r"of one size .*, got \(16, 32, 3\) and \(24, 32, 3\): write image"),
        (None, [IMAGES[0], IMAGES[1, ..., 0]], r"of as many channels, .*: write image.convert\('RGB'\)"),
        (None, [np.moveaxis(x, -1, 0) for x in IMAGES], r"^X\[0\] .* move the channels last"),
        ((24, 32), np.ma.masked_equal(IMAGES, IMAGES.max()).reshape(2, -1), "masks some"),
        (None, iter(IMAGES), r"got a?.*iterator: write list"),
    ],
)
def test_other_images_are_refused(image_size: Any, images: Any, words: str) -> None:
    with np.errstate(divide="ignore"), pytest.raises((ValueError, TypeError), match=words):
        HOGTransformer(image_size=image_size).fit(images)


LISTS = {
    "a tensor": lambda images: torch.from_numpy(images).permute(0, 3, 1, 2),
    "bytes and floats": lambda images: [images[0], images[1] / 255],
    "an array of arrays": lambda images: np.array([*images, None], object)[:-1],
    "some transparent": lambda images: [Image.fromarray(images[0]), opaque(images[1])],
}


def opaque(image: np.ndarray) -> Image.Image:
    rgba = Image.fromarray(image)
    rgba.putalpha(255)
    return rgba


@pytest.mark.parametrize("name", LISTS)
def test_lists_are_described_as_their_images(name: str) -> None:
    expected = HOGTransformer("paper").fit_transform(IMAGES)  # whose ε is absolute
    np.testing.assert_allclose(HOGTransformer("paper").fit_transform(LISTS[name](IMAGES)), expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("image_size", [None, (24, 32)])
def test_images_of_another_shape_than_in_fit_are_refused(image_size: Any) -> None:
    """Their rows can be as long, and mean something else."""
    fitted = HOGTransformer("paper", image_size=image_size).fit(IMAGES if image_size is None else IMAGES.reshape(2, -1))
    others = IMAGES.swapaxes(1, 2), IMAGES[..., :1], IMAGES[:, :22], IMAGES[:, :, :16]
    for images in others if image_size is None else [IMAGES[..., 0].reshape(2, -1)]:
        with pytest.raises(ValueError, match=r"^X has .* but HOGTransformer is expecting"):
            fitted.transform(images)
    if image_size is not None:
        with pytest.raises(ValueError, match=r"images of shape \(32, 24, 3\), .* expecting \(24, 32, 3\) as in fit"):
            fitted.set_params(image_size=image_size[::-1]).transform(IMAGES.reshape(2, -1))


@pytest.mark.parametrize(("dtype", "expected"), [("f2", "f8"), ("f4", "f4"), ("f8", "f8"), ("u1", "f4")])
def test_dtypes(dtype: str, expected: str) -> None:
    assert HOGTransformer("paper").fit_transform((IMAGES / 255).astype(dtype)).dtype == expected
