"""The options of a dialect: which spec they ask for, and what contradicts them."""

from __future__ import annotations

import re
from typing import Any

import pytest

from nablahog import presets
from nablahog.cli.arguments.preset_parameters import PRESETS, parameters_of
from nablahog.cli.inputs.spec import SpecOptions
from nablahog.hog import HOGSpec


@pytest.mark.parametrize(
    ("options", "spec"),
    [
        (SpecOptions(), presets.uoctti(8)),
        (SpecOptions("paper", (8, 6)), presets.paper((8, 6))),
        (SpecOptions("paper", vote="linear"), presets.paper()),
        (SpecOptions("aubry", (5, 5), "hard"), presets.aubry(5, vote="hard")),
        (SpecOptions("vlfeat", (4, 4), "linear"), presets.vlfeat(cell_size=4, bilinear_orientations=True)),
        (SpecOptions("cnn_hog", vote="linear"), presets.cnn_hog(bilinear=True)),
        (SpecOptions("skimage", (6, 4)), presets.skimage(pixels_per_cell=(6, 4))),
        (SpecOptions("opencv", (4, 8)), presets.opencv(cell_size=(8, 4))),  # (width, height) there
        (SpecOptions("maskfeat", settings=(("nbins", "6"), ("nbins", "7"))), presets.maskfeat(nbins=7)),
        (SpecOptions("skimage", settings=(("channel_axis", "2"),)), presets.skimage(channel_axis=2)),
        (SpecOptions(settings=(("orientations", "6"),)), presets.uoctti(orientations=6)),
    ],
)
def test_what_is_options(options: SpecOptions, spec: HOGSpec) -> None:
    assert options.spec() == spec


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"descriptor": "dlib", "settings": (("a", "1"),)}, "--set: dlib has no parameter 'a', but cell_size"),
        ({"descriptor": "dlib", "settings": (("cell_size", "a"),)}, "--set cell_size: expected an integer"),
        ({"descriptor": "dlib", "cell": (8, 6)}, "cells of dlib are square: expected --cell N, got 8x6"),
        ({"descriptor": "opencv", "cell": (5, 5)}, "opencv with cell_size=5x5: along the width, a block must be"),
        ({"descriptor": "skimage", "settings": (("orientations", "2"),)}, "skimage with orientations=2: bins must be"),
        ({"descriptor": "cnn_hog", "cell": (0, 0)}, "cnn_hog with cell_size=0: cell_size must be"),
        ({"descriptor": "opencv", "settings": (("block_stride", "0"),)}, "opencv with block_stride=0x0: along the"),
        (
            {"descriptor": "dpm", "cell": (8, 8), "settings": (("cell_size", "8"),)},
            "--cell and --set cell_size say the same: expected one of them",
        ),
        (
            {"descriptor": "opencv", "vote": "hard"},
            "the opencv descriptor has linear votes: --vote hard goes with aubry, cnn_hog, uoctti, vlfeat",
        ),
        ({"descriptor": "dpm", "vote": "linear"}, "the dpm descriptor has hard votes: --vote linear goes with"),
    ],
)
def test_what_cannot_be(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        SpecOptions(**options)


def _refusal(name: str, key: str, text: str) -> str | None:
    try:
        SpecOptions(name, settings=((key, text),))
    except ValueError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", PRESETS)
def test_any_small_value_is_a_spec_or_a_sentence(name: str) -> None:
    for key in parameters_of(name):
        for text in ("-1", "0", "1", "2", "3", "7", "0x0", "3x1", "0.5", "none", "true"):
            refusal = _refusal(name, key, text)
            assert refusal is None or (key in refusal and "\n" not in refusal)


@pytest.mark.parametrize(
    ("options", "spec", "message"),
    [
        (SpecOptions("skimage"), presets.skimage(feature_vector=False), None),  # another layout of the same
        (SpecOptions("skimage"), presets.skimage(pixels_per_cell=(6, 6)), None),
        (
            SpecOptions("skimage", (8, 8)),
            presets.skimage(pixels_per_cell=(6, 6)),
            "its cell_size is (6, 6), not (8, 8)",
        ),
        (
            SpecOptions("skimage", settings=(("pixels_per_cell", "8"),)),
            presets.skimage(pixels_per_cell=(6, 6)),
            "its cell_size is (6, 6), not (8, 8)",
        ),
        (SpecOptions(settings=(("orientations", "6"),)), presets.uoctti(), "its bins is 18, not 12"),
        (SpecOptions("vlfeat"), presets.vlfeat(cell_size=4), None),
        (SpecOptions("dlib"), presets.dpm(), "its name is 'dpm', not 'dlib'"),
    ],
)
def test_descriptor_files_that_say_the_same(options: SpecOptions, spec: HOGSpec, message: str | None) -> None:
    if message is None:
        options.check(spec)
    else:
        with pytest.raises(ValueError, match="another spec than asked for") as error:
            options.check(spec)
        assert message in str(error.value)
