"""The options of a preset: which spec they ask for, and what contradicts them."""

from __future__ import annotations

import pytest

from nablahog import presets
from nablahog.cli.arguments.presets import PRESETS, SpecOptions, parameters_of
from nablahog.hog import HOGSpec


@pytest.mark.parametrize(
    ("options", "spec"),
    [
        (SpecOptions(), presets.uoctti(8)),
        (SpecOptions("aubry"), presets.aubry(8)),
        (SpecOptions("paper", (("cell_size", "8x6"),)), presets.paper((8, 6))),
        (SpecOptions("vlfeat", (("bilinear_orientations", "true"),)), presets.vlfeat(bilinear_orientations=True)),
        (SpecOptions("maskfeat", (("nbins", "6"), ("nbins", "7"))), presets.maskfeat(nbins=7)),
        (SpecOptions(settings=(("orientations", "6"),)), presets.uoctti(orientations=6)),
    ],
)
def test_what_options_ask_for(options: SpecOptions, spec: HOGSpec) -> None:
    assert options.spec() == spec


def _refusal(name: str, key: str, text: str) -> str | None:
    try:
        SpecOptions(name, ((key, text),))
    except ValueError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", PRESETS)
def test_any_small_value_is_a_spec_or_a_sentence(name: str) -> None:
    for key in (*parameters_of(name), "nonsense"):
        for text in ("-1", "0", "2", "3x1", "0.5", "none"):
            refusal = _refusal(name, key, text)
            assert refusal is None or (key in refusal and "\n" not in refusal)


@pytest.mark.parametrize(
    ("options", "spec", "differing"),
    [
        (SpecOptions("skimage"), presets.skimage(feature_vector=False), None),  # another layout of the same
        (SpecOptions("skimage"), presets.skimage(pixels_per_cell=(6, 6)), None),  # not asked for
        (SpecOptions("skimage", (("pixels_per_cell", "8"),)), presets.skimage(pixels_per_cell=(6, 6)), "cell_size"),
        (SpecOptions("uoctti", (("vote", "hard"),)), presets.uoctti(), "vote"),
        (SpecOptions("dlib"), presets.dpm(), "name"),
        (SpecOptions("paper"), presets.paper(bins=6), "bins"),
    ],
)
def test_descriptor_files_and_options(options: SpecOptions, spec: HOGSpec, differing: str | None) -> None:
    if differing is None:
        options.check(spec)
    else:
        with pytest.raises(ValueError, match=f"another spec than asked for: its {differing} is"):
            options.check(spec)
