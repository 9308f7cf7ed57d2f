"""Arguments of several functions that are no numbers: callbacks, files, names."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import nablahog
from nablahog import estimate_pose, hog, load_descriptor, reconstruct, save_descriptor, train_prior, which_hog

from .boundary.columns.plain import BOX, DESCRIPTOR, IMAGE, MESH, SIZE, SMALL


def test_paths(tmp_path: Path) -> None:
    """They may be bytes."""
    path: Any = os.fsencode(tmp_path / "d.npz")
    save_descriptor(path, DESCRIPTOR[0], "uoctti", SIZE)
    assert torch.equal(load_descriptor(path).descriptor, DESCRIPTOR[0])
    none: list[Any] = [None, 3]
    for path in (*none, io.BytesIO(b"x")):
        for read in (load_descriptor, nablahog.load_mesh, nablahog.LearnedPrior.load):
            with pytest.raises(TypeError, match="must be a path"):
                read(path)
    for path in (*none, io.StringIO()):
        with pytest.raises(TypeError, match="a path or a binary stream"):
            save_descriptor(path, DESCRIPTOR[0], "uoctti", SIZE)


def test_callbacks_are_functions() -> None:
    quick: dict[str, Any] = {"quality": "fast", "prior": None}
    for call in (
        lambda: estimate_pose(IMAGE, MESH, box=BOX, progress=None),  # type: ignore[arg-type]
        lambda: estimate_pose(IMAGE, MESH, box=BOX, watch=3),  # type: ignore[arg-type]
        lambda: reconstruct(DESCRIPTOR, "uoctti", SIZE, progress=3, **quick),
        lambda: reconstruct(DESCRIPTOR, "uoctti", SIZE, watch=3, **quick),
        lambda: nablahog.reconstruct_multiscale(DESCRIPTOR, "uoctti", SIZE, progress=3),  # type: ignore[arg-type]
    ):
        with pytest.raises(TypeError, match="must be a function"):
            call()


def test_images_of_a_search_are_in_0_to_1() -> None:
    for name in ("start", "expected"):
        with pytest.raises(ValueError, match="divide by the value of white"):
            reconstruct(DESCRIPTOR, "uoctti", SIZE, quality="fast", prior=None, **{name: SMALL * 255})
        with pytest.warns(UserWarning, match="far beyond 0…1") as caught:
            reconstruct(DESCRIPTOR, "uoctti", SIZE, quality="fast", prior=None, **{name: SMALL * 2 - 1})
        assert caught[0].filename == __file__


def test_images_to_learn_from_have_names_that_are_texts() -> None:
    images: list[Any] = [{0: IMAGE, "a": IMAGE}, [IMAGE]]
    for some, says in zip(images, ("str", "images must be a dict of images by name, got list: write "), strict=True):
        with pytest.raises(TypeError, match=says):
            train_prior(some, "uoctti", epochs=1)


def test_which_hog_takes_what_other_functions_take() -> None:
    vector = hog(IMAGE, "skimage", layout="native")
    found = which_hog(vector, IMAGE.shape)
    for same in (torch.from_numpy(vector), vector.tolist(), vector.astype(object), vector[::-1].copy()[::-1]):
        assert which_hog(same, IMAGE.shape) == found  # type: ignore[arg-type]
    wrong: list[tuple[Any, str]] = [
        *((value, "real numbers") for value in (None, "d.npz", vector + 0j)),
        (np.ma.masked_array(vector, vector > 0.1), "masked"),
        (np.float32(3), "one number"),
    ]
    for value, says in wrong:
        with pytest.raises((TypeError, ValueError), match=says):
            which_hog(value)
    with pytest.raises(TypeError, match="must be a dict"):
        which_hog(vector, dialects=["skimage"])  # type: ignore[arg-type]
