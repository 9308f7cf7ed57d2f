"""reconstruct, as a user calls it."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
import torch
from torch import Tensor

import nablahog
from nablahog import HOGSpec, hog, presets, reconstruct

from .photographs import photograph

SPECS = {
    "uoctti": presets.uoctti(8),
    "uoctti-hard": presets.uoctti(8, vote="hard"),
    "uoctti-rectangular": presets.uoctti((8, 5)),
    "paper": presets.paper(8),
    "paper-robust": presets.paper(8, global_form="robust"),
    "signed-global": dataclasses.replace(presets.paper(8), signed=True, bins=8, partial_cells="ceil"),
}


def correlation(a: Tensor, b: Tensor) -> float:
    return float(torch.corrcoef(torch.stack([a.flatten(), b.flatten()]))[0, 1])


@pytest.mark.parametrize("name", SPECS)
def test_the_returned_image_explains_the_descriptor(name: str) -> None:
    spec = SPECS[name]
    image = photograph(61)
    descriptor = hog(image, spec)
    found = reconstruct(descriptor, spec, image_size=(61, 61), max_evaluations=120)
    assert found.image.shape == (1, 1, 61, 61)
    assert found.image.dtype == torch.float32
    assert found.image.min() >= 0
    assert found.image.max() <= 1
    recomputed = (hog(found.image, spec) - descriptor).norm() / descriptor.norm()
    torch.testing.assert_close(found.distance[0], recomputed)
    assert found.distance[0] < (0.5 if spec.vote == "hard" else 0.25)
    assert len(found.stop_reason) == 1
    assert found.history.shape[0] == int(found.evaluations[0]) <= 120
    assert found.history[-1, 0] < found.history[0, 0]
    assert found.seconds > 0


def test_a_photograph_comes_back() -> None:
    spec = presets.uoctti(8)
    images = torch.cat([photograph(128, name) for name in ("camera", "astronaut", "coffee")])
    found = reconstruct(hog(images, spec), spec, max_evaluations=150)
    for pre_image, image in zip(found.image, images, strict=True):
        assert correlation(pre_image, image) > 0.85


def test_same_seed_same_image() -> None:
    spec = presets.uoctti(8)
    descriptor = hog(photograph(32), spec)
    first, again, other = (reconstruct(descriptor, spec, seed=s, max_evaluations=30).image for s in (0, 0, 1))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_batch_equals_loop() -> None:
    spec = presets.uoctti(8)
    images = torch.cat([photograph(48, name) for name in ("camera", "coins")]).double()
    descriptors = hog(images, spec)
    together = reconstruct(descriptors, spec, max_evaluations=25)
    for i in range(2):
        alone = reconstruct(descriptors[i : i + 1], spec, max_evaluations=25)
        torch.testing.assert_close(together.image[i], alone.image[0], atol=1e-3, rtol=0)


def test_a_flat_photograph_is_found_exactly() -> None:
    for spec in (presets.uoctti(8), presets.paper(8)):
        found = reconstruct(hog(torch.full((1, 1, 32, 32), 0.7), spec), spec, max_evaluations=20)
        assert found.image.unique().numel() == 1
        assert found.distance.item() == 0


@pytest.mark.parametrize("budget", [2, 3, 5, 10])
def test_progress_counts_up_to_the_budget(budget: int) -> None:
    calls: list[tuple[int, int]] = []
    spec = presets.paper(8)
    found = reconstruct(
        hog(photograph(32), spec), spec, max_evaluations=budget, progress=lambda *call: calls.append(call)
    )
    assert calls == [(i, budget) for i in range(1, budget + 1)]
    assert found.evaluations.tolist() == [budget]


@pytest.mark.parametrize("size", [(1, 9), (9, 1), (2, 9), (3, 3)])
@pytest.mark.parametrize("spec", [presets.paper(1), presets.uoctti(2)], ids=["paper", "uoctti"])
def test_images_of_a_few_pixels(size: tuple[int, int], spec: HOGSpec) -> None:
    image = torch.rand(1, 1, *size, generator=torch.Generator().manual_seed(0))
    found = reconstruct(hog(image, spec), spec, image_size=size, max_evaluations=20)
    assert torch.isfinite(found.image).all()
    assert torch.isfinite(found.history).all()
    assert torch.isfinite(found.distance).all()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"basis": "wavelets"}, "'cosine', 'pixels', got 'wavelets'"),
        ({"max_evaluations": 1}, "at least 2.*got 1"),
        ({"smoothness": -1.0}, "at least 0, got -1"),
        ({"smoothness": float("nan")}, "finite"),
    ],
)
def test_options_out_of_range(options: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        reconstruct(torch.rand(1, 4, 4, 9), presets.paper(8), **options)


def test_pixels_are_a_basis_too() -> None:
    spec = presets.uoctti(8)
    descriptor = hog(photograph(64), spec)
    found = reconstruct(descriptor, spec, basis="pixels", max_evaluations=60)
    assert found.distance[0] < 0.6


def test_smoothness_makes_neighbours_agree() -> None:
    spec = presets.uoctti(8)
    descriptor = hog(photograph(64), spec)
    rough, smooth = (reconstruct(descriptor, spec, smoothness=w, max_evaluations=80).image for w in (0.0, 0.3))

    def variation(image: Tensor) -> Tensor:
        return image.diff(dim=-1).abs().mean() + image.diff(dim=-2).abs().mean()

    assert variation(smooth) < variation(rough)


def test_the_descriptor_carries_no_gradient_and_is_not_changed() -> None:
    spec = presets.uoctti(8)
    descriptor = hog(photograph(32), spec).requires_grad_()
    before = descriptor.detach().clone()
    assert not reconstruct(descriptor, spec, max_evaluations=5).image.requires_grad
    assert torch.equal(descriptor, before)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_cpu_and_cuda_start_alike() -> None:
    spec = presets.uoctti(8)
    descriptor = hog(photograph(64), spec).double()
    cpu, cuda = (reconstruct(descriptor.to(d), spec, max_evaluations=15).image.cpu() for d in ("cpu", "cuda"))
    torch.testing.assert_close(cpu, cuda, atol=1e-3, rtol=0)


@pytest.mark.parametrize(
    ("descriptor", "spec", "size", "error", "says"),
    [
        (
            torch.zeros(16, 16, 31),
            presets.uoctti(),
            None,
            ValueError,
            r"\(B, rows, cols, channels\).*got \(16, 16, 31\)",
        ),
        (torch.zeros(0, 16, 16, 31), presets.uoctti(), None, ValueError, "B at least 1"),
        (torch.zeros(1, 4, 4, 9), presets.uoctti(), None, ValueError, r"\(4, 4, 31\).*got \(4, 4, 9\)"),
        (torch.zeros(1, 4, 4, 31), presets.uoctti(), (64, 64), ValueError, r"64x64.*\(8, 8, 31\)"),
        (torch.zeros(1, 4, 4, 31).long(), presets.uoctti(), None, TypeError, "float32 or float64.*int64"),
        ([1.0], presets.uoctti(), None, TypeError, "list"),
        (torch.full((1, 4, 4, 31), torch.nan), presets.uoctti(), None, ValueError, "finite"),
        (torch.full((1, 4, 4, 9), torch.inf), presets.paper(), None, ValueError, "finite"),
        (torch.zeros(1, 1, 1, 9), presets.paper(), (4, 4), ValueError, "at least one cell"),
    ],
)
def test_bad_input_says_what_was_expected(
    descriptor: Tensor, spec: HOGSpec, size: tuple[int, int] | None, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        reconstruct(descriptor, spec, image_size=size)


def test_public_names() -> None:
    assert {"hog", "HOG", "HOGSpec", "presets", "reconstruct"} <= set(nablahog.__all__)
