"""What ``hog`` refuses, and what it takes beside tensors.  Other kinds of input: ``tests/boundary``."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch.nn.functional import pad

from nablahog import HOGLoss, reconstruct, stream
from nablahog.hog import HOG, HOGSpec, hog, presets

SPEC = presets.paper()
LEVELS = np.random.default_rng(0).integers(0, 65536, (2, 9, 16, 3), np.uint16)
BATCH = torch.from_numpy(LEVELS / 65535).permute(0, 3, 1, 2)
# what is not taken, and the images that are meant
REFUSED: dict[str, tuple[Any, Any]] = {
    "one image": (BATCH[0], BATCH[:1]),
    "a gray plane": (BATCH[0, 0], BATCH[:1, :1]),
    "16 bits": (torch.from_numpy(LEVELS).permute(0, 3, 1, 2), BATCH),
    "channels last": (BATCH.permute(0, 2, 3, 1), BATCH),
    "channels last of one image": (BATCH[0].permute(1, 2, 0), BATCH[:1]),
    "an array with channels first": (BATCH[0].numpy(), BATCH[:1]),
    "arrays with channels first": (BATCH.numpy(), BATCH),
    "arrays of gray images": (BATCH[:, 0].numpy(), BATCH[:, :1]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_to_be_written_is_right(case: str) -> None:
    """The end of the sentence is Python."""
    images, meant = REFUSED[case]
    with pytest.raises((TypeError, ValueError), match=r"^[^\n]+$") as raised:
        hog(images, SPEC)
    (code,) = re.findall(r"(?:write |last, )([^;:]*?\S)(?= for |$|;)", str(raised.value))
    written = eval(code, {"images": images, "array": images, "np": np})
    np.testing.assert_allclose(np.asarray(hog(written, SPEC)).reshape(len(meant), 1, 2, 9), hog(meant, SPEC), atol=1e-5)


@pytest.mark.parametrize("shape", [(1, 0, 8, 8), (1, 1, 0, 8), (1, 1, 7, 8)])
def test_images_without_a_cell_or_a_channel_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="at least one c"):
        hog(torch.zeros(shape), SPEC)


@pytest.mark.parametrize("channels", [2, 4])
def test_separate_colours_are_one_or_three(channels: int) -> None:
    spec = replace(SPEC, colour="separate")
    for call in (lambda: hog(torch.zeros(1, channels, 8, 8), spec), lambda: stream(np.zeros((8, 8, channels)), spec)):
        with pytest.raises(ValueError, match=f"needs images of 1 or 3 channels, got {channels}"):
            call()


def test_other_options_are_refused() -> None:
    images: Any = torch.zeros(1, 1, 8, 8)
    for make in (lambda: hog(images, "Skimage"), lambda: HOG("Skimage")):
        with pytest.raises(ValueError, match=r"'Skimage'; did you mean 'skimage'\?$"):
            make()
    for options in ({"layout": "planes"}, {"backend": "cpu"}):
        with pytest.raises(ValueError, match=r"^(layout|backend) must be one of "):
            hog(images, "paper", **options)  # type: ignore[call-overload]


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        (presets.opencv, r"write nablahog\.presets\.opencv\(\), or 'opencv'"),
        (None, "got None: write 'uoctti'"),
        (HOG("opencv"), "write its `spec`"),
        ({"name": "opencv"}, "write 'uoctti'"),
    ],
)
def test_what_is_no_spec_is_answered_with_what_to_write(spec: Any, words: str) -> None:
    descriptor = torch.zeros(1, 8, 8, 31)
    for call in (
        HOG,
        HOGLoss,
        lambda spec: hog(descriptor, spec),
        lambda spec: reconstruct(descriptor, spec, (64, 64)),
    ):
        with pytest.raises(TypeError, match=words):
            call(spec)


def test_settings_beside_a_preset_are_put_into_it() -> None:
    with pytest.raises(TypeError, match=r"write nablahog\.HOG\(nablahog\.presets\.opencv\(nbins=8\)\)"):
        HOG(presets.opencv, nbins=8)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"presets\.paper\(cell_size=4\)"):
        HOG("paper", cell_size=4)
    with pytest.raises(TypeError, match=r"presets\.uoctti\(cell_size=4\)"):
        HOG("of another library", cell_size=4)


ODD_IMAGES = {
    "0…255": (torch.full((1, 1, 16, 16), 255.0), "uoctti", "divide those in 0…255 by 255, or pass uint8"),
    "0…255 as an array": (np.full((16, 16), 255.0), "uoctti", "divide those in 0…255 by 255"),
    "digits in 0…16, black corners": (pad(torch.full((1, 1, 6, 6), 16.0), (1, 1, 1, 1)), "paper", "far beyond 0…1"),
    "standardised": (torch.linspace(2.6, -2.1, 768).reshape(1, 3, 16, 16), "paper", "far beyond 0…1"),
    "of tanh": (torch.linspace(-1, 1, 256).reshape(1, 1, 16, 16), "opencv", r"pass \(images \+ 1\) / 2"),
    "of tanh, large": (torch.linspace(-1, 1, 2**14).reshape(1, 1, 128, 128), "opencv", r"pass \(images \+ 1\) / 2"),
    "halves": (torch.full((1, 1, 16, 16), 255.0, dtype=torch.half), "uoctti", "divide those in 0…255 by 255"),
    "RGBA": (torch.zeros(1, 4, 16, 16), "uoctti", r"images have 4 channels, .* write images\[:, :3\]"),
    "colours": (torch.zeros(1, 3, 24, 24), "skimage", r"write presets\.skimage\(channel_axis=-1\)"),
}


@pytest.mark.parametrize("case", ODD_IMAGES)
def test_images_that_are_seldom_meant_are_asked_about(case: str) -> None:
    images, spec, words = ODD_IMAGES[case]
    with pytest.warns(UserWarning, match=words) as warned:
        hog(images, spec)
    assert [warning.filename for warning in warned] == [__file__]


@pytest.mark.parametrize("case", [case for case in ODD_IMAGES if isinstance(ODD_IMAGES[case][0], torch.Tensor)])
def test_a_loss_asks_once_about_images_and_targets(case: str) -> None:
    images, spec, words = ODD_IMAGES[case]
    with pytest.warns(UserWarning, match=f"^input and target: .*{words}") as warned:
        HOGLoss(spec)(images, images)
    assert [warning.filename for warning in warned] == [__file__]


def test_a_loss_says_whether_images_or_targets_are_meant() -> None:
    images = torch.rand(1, 1, 32, 32)
    with pytest.warns(UserWarning, match="^input: images of floats"):
        HOGLoss("uoctti")(255 * images, images)
    with pytest.warns(UserWarning, match="^target: images of floats"):
        HOGLoss("uoctti")(images, 255 * images)


@pytest.mark.parametrize("channels", [1, 2, 3, 5])
@pytest.mark.parametrize("spec", ["paper", "uoctti", "opencv", presets.skimage(channel_axis=-1)])
def test_others_are_not(channels: int, spec: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        images = torch.rand(1, channels, 64, 64)
        hog(images, spec)
        hog(2 * images - 0.5, spec)  # a filter may overshoot
        hog((255 * images).byte(), spec)


@pytest.mark.slow
def test_a_line_is_warned_of_once() -> None:
    """After the first call, which may compile: changes of Python's filters, as of libraries that load, begin anew."""
    program = """import torch, nablahog
for white in (1, 255, 255, 255):
    nablahog.hog(torch.full((1, 1, 8, 8), float(white)), "paper")"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    assert ended.stderr.count("far beyond 0…1") == 1


def test_a_width_of_three_pixels_may_be_a_cell() -> None:
    """Images of many channels, too, that look as if channels came last."""
    spec = replace(presets.paper(cell_size=5), partial_cells="round")
    assert hog(torch.rand(2, 5, 3, 3), spec).shape[1:3] == (1, 1)


# --- arrays in place of tensors, and lists of tuples ------------------------------------------------------------------

UOCTTI = presets.uoctti(cell_size=8)


def photograph(shape: tuple[int, ...], dtype: Any = np.float32) -> NDArray[Any]:
    values = np.random.default_rng(0).random(shape)
    return (values * 255).astype(np.uint8) if dtype == np.uint8 else values.astype(dtype)


def channels_first(array: NDArray[Any]) -> torch.Tensor:
    """Images (B, C, H, W), by the rule of docs/conventions.md."""
    shape = array.shape
    batch = array.reshape((1, *shape, 1) if array.ndim == 2 else (1, *shape) if array.ndim == 3 else shape)
    return torch.from_numpy(np.ascontiguousarray(batch.transpose(0, 3, 1, 2)))


@pytest.mark.parametrize("dtype", [np.uint8, np.float32, np.float64])
@pytest.mark.parametrize(
    "shape", [(16, 24), (16, 24, 1), (16, 24, 3), (2, 16, 24, 1), (2, 16, 24, 3), (1, 16, 24, 3), (3, 16, 3)]
)
def test_arrays_have_their_channels_last(shape: tuple[int, ...], dtype: Any) -> None:
    array = photograph(shape, dtype)
    if shape == (3, 16, 3):  # rows, not channels, whatever their number
        array = np.repeat(array, 4, axis=0)
    expected = hog(channels_first(array), UOCTTI).numpy()
    descriptor = hog(array, UOCTTI)
    assert isinstance(descriptor, np.ndarray)
    assert descriptor.dtype == expected.dtype
    np.testing.assert_array_equal(descriptor, expected if array.ndim == 4 else expected[0])
    np.testing.assert_array_equal(HOG(UOCTTI)(array), descriptor)


@pytest.mark.parametrize("spec", [UOCTTI, presets.opencv(win_size=(16, 16))], ids=["paper", "opencv"])
def test_signs_that_are_a_bit(spec: HOGSpec) -> None:
    image = torch.rand(1, 1, 24, 24)
    negative: torch.Tensor = torch._neg_view(-image)  # type: ignore[attr-defined]
    assert negative.is_neg()
    assert torch.equal(hog(negative, spec), hog(image, spec))
    leaf = image.clone().requires_grad_()
    cotangent = torch.rand_like(hog(image, spec))
    (grad,) = torch.autograd.grad(hog(leaf, spec), leaf, cotangent)
    (same,) = torch.autograd.grad(hog(leaf, spec), leaf, torch._neg_view(-cotangent))  # type: ignore[attr-defined]
    assert torch.equal(same, grad)


def test_lists_are_tuples() -> None:
    spec = presets.opencv(win_size=[64, 64], block_size=[16, 16])  # type: ignore[arg-type]
    listed = replace(
        spec,
        cell_size=[8, 8],  # type: ignore[arg-type]
        normalizer=replace(spec.normalizer, block=[2, 2], step=[2, 2]),
        pooling=replace(spec.pooling, block=[16, 16], step=[8, 8]),
    )
    assert listed == spec
    assert hash(listed) == hash(spec)
    parts = replace(UOCTTI.normalizer, parts=["directed", "undirected", "texture"])
    assert replace(UOCTTI, normalizer=parts) == UOCTTI
    assert presets.uoctti([8, 8]) == UOCTTI  # type: ignore[arg-type]
