"""What needs gradients has them, in any mode of PyTorch."""

from __future__ import annotations

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


def test_no_table_is_kept_that_gradients_cannot_pass() -> None:
    """Results in other modes are those of ``tests/boundary/rows/contexts.py``."""
    image = torch.rand(1, 1, 48, 48)
    with torch.inference_mode():
        nablahog.hog(image, "vlfeat", backend="torch")
    leaf = image.requires_grad_()
    nablahog.hog(leaf, "vlfeat", backend="torch").sum().backward()
    assert leaf.grad is not None
