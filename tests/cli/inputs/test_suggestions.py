"""Which presets an array fits, and that what is suggested works."""

from __future__ import annotations

import pytest

from nablahog.cli.arguments.main import parser
from nablahog.cli.inputs.arrays import ArrayOptions
from nablahog.cli.inputs.spec import SpecOptions
from nablahog.cli.inputs.suggestions import MOST, presets_that_fit


@pytest.mark.parametrize(
    ("shape", "size", "options"),
    [
        ((3780,), (128, 64), "--preset opencv"),
        ((3780,), None, "--preset opencv --image-size 128x64"),
        ((6804,), None, "--preset skimage --image-size 128x64"),
        ((1764,), None, "--preset opencv --image-size 64x64"),
        ((16, 16, 32), None, "--preset dpm"),
        ((16, 16, 31), (64, 64), "--preset dlib --image-size 144x144"),
        ((31, 8, 8), None, "--preset vlfeat"),
    ],
)
def test_what_fits(shape: tuple[int, ...], size: tuple[int, int] | None, options: str) -> None:
    fitting = presets_that_fit(shape, size)
    assert options in [preset.options for preset in fitting]
    assert len(fitting) <= MOST
    for preset in fitting:  # each works as it stands
        arguments = parser().parse_args(["glyph", "hog.npy", "-o", "out", *preset.options.split()])
        known = ArrayOptions(arguments.image_size or size)
        _, how = known.fitting(shape, SpecOptions.of(arguments))
        assert how.shape == shape


@pytest.mark.parametrize("shape", [(), (0,), (2,), (5, 0, 31), (2, 2, 2, 2), (100_003,)])
def test_nothing_fits(shape: tuple[int, ...]) -> None:
    assert presets_that_fit(shape, None) == []


@pytest.mark.parametrize(
    ("shape", "spec", "arrays", "message"),
    [
        ((3780,), SpecOptions(), ArrayOptions((128, 64)), r"expected --preset NAME; this fits --preset opencv"),
        ((3780,), SpecOptions("skimage"), ArrayOptions((128, 64)), r"has the shape \(6804,\) .*, got \(3780,\)"),
        ((7936,), SpecOptions("vlfeat"), ArrayOptions(), "do not say how large their image was"),
        ((5, 3780), SpecOptions("opencv"), ArrayOptions(), "expected one descriptor in a file, got 5"),
        ((3780,), SpecOptions("skimage"), ArrayOptions((9, 9)), "too few"),
        ((3780,), SpecOptions("opencv", (("win_size", "64x128"),)), ArrayOptions((64, 64)), "contradict each other"),
    ],
)
def test_what_is_refused(shape: tuple[int, ...], spec: SpecOptions, arrays: ArrayOptions, message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        arrays.fitting(shape, spec)
    assert "\n" not in str(error.value)
