"""What needs gradients has them, in any mode of PyTorch."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

import nablahog
from nablahog.runtime.pytorch import in_plain_mode


@in_plain_mode
def _gradient(x: Tensor, *, weight: Tensor) -> Tensor:
    """Of Σ (x · weight)², with respect to x, plus what new tensors are."""
    with torch.enable_grad():
        leaf = x.detach().requires_grad_()
        (leaf @ weight).square().sum().backward()
    assert leaf.grad is not None
    return leaf.grad + torch.zeros(())


def test_modes_of_the_caller_are_off_meanwhile() -> None:
    x, weight = torch.rand(3, 4), torch.rand(4, 2)
    expected = _gradient(x, weight=weight)
    with torch.inference_mode():
        assert torch.equal(_gradient(x.clone(), weight=weight.clone()), expected)
        assert torch.is_inference_mode_enabled()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert torch.equal(_gradient(x, weight=weight), expected)
        assert torch.is_autocast_enabled("cpu")
    with torch.device("meta"):
        assert torch.equal(_gradient(x, weight=weight), expected)
        assert torch.empty(1).device.type == "meta"


def _pose(image: Tensor) -> float:
    mesh = next(iter(nablahog.sample_chairs().values()))
    return nablahog.estimate_pose(image, mesh, box=(8, 8, 88, 88), initial=(0.0, 20.0), within=10.0).azimuth


@pytest.mark.parametrize("mode", ["inference", "autocast", "device"])
def test_whatever_the_callers_mode(mode: str) -> None:
    image = torch.rand(1, 1, 96, 96, generator=torch.Generator().manual_seed(0))
    descriptor = nablahog.hog(image, "uoctti")
    calls: list[Callable[[], object]] = [
        lambda: nablahog.hog(image, "uoctti").tolist(),
        lambda: nablahog.hog(image.numpy()[0, 0], "skimage").tolist(),
        lambda: nablahog.glyphs(descriptor[0], "uoctti").tolist(),
        lambda: nablahog.reconstruct(descriptor, "uoctti", (96, 96), quality="fast", prior="default").image.tolist(),
        lambda: _pose(image[0]),
    ]
    expected = [call() for call in calls]
    modes = {
        "inference": torch.inference_mode(),
        "autocast": torch.autocast("cpu", dtype=torch.bfloat16),
        "device": torch.device("meta"),
    }
    with modes[mode]:
        assert [call() for call in calls] == expected
    leaf = image.clone().requires_grad_()  # no table was kept that gradients cannot pass
    nablahog.hog(leaf, "vlfeat", backend="torch").sum().backward()
    assert leaf.grad is not None
