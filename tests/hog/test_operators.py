"""The operators of ``torch.library`` that are the compiled steps."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from nablahog.hog import hog, operators
from nablahog.hog.descriptor import histograms
from nablahog.hog.kernels import supports

from .zoo import SPECS, noise

CELLS_VJP, DESCRIBE_VJP = torch.ops.nablahog.cells_vjp.default, torch.ops.nablahog.describe_vjp.default


def _with_gradient(step: Any, x: Tensor) -> tuple[Tensor, Tensor]:
    x = x.detach().requires_grad_()
    output = step(x)
    weights = torch.linspace(0, 40, output.numel(), dtype=x.dtype).cos().view(output.shape)
    return output.detach(), torch.autograd.grad((output * weights).sum(), x)[0]


@pytest.mark.parametrize("name", ["paper", "uoctti", "opencv", "maskfeat"])
@pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor that is not a leaf")  # read by PyTorch 2.14's check
def test_operators_pass_opcheck(name: str) -> None:
    text = SPECS[name].to_json()
    for images in (noise(2, 3, 14, 13).requires_grad_(), noise(1, 1, 14, 13, dtype=torch.float32)):
        torch.library.opcheck(operators.cells, (images, text))
        torch.library.opcheck(operators.describe, (images, text))
        for step, vjp in ((operators.cells, CELLS_VJP), (operators.describe, DESCRIBE_VJP)):
            torch.library.opcheck(vjp, (images.detach(), torch.ones_like(step(images.detach(), text)), text))


@pytest.mark.parametrize("name", [name for name, s in SPECS.items() if supports(s) and s.normalizer.has_loops])
def test_operators_are_the_functions(name: str) -> None:
    s, text = SPECS[name], SPECS[name].to_json()
    for x in (noise(2, 3, 14, 13), noise(1, 1, 14, 13)):
        for one, other in zip(
            _with_gradient(lambda images: hog(images, s), x),
            _with_gradient(lambda images: operators.describe(images, text), x),
            strict=True,
        ):
            assert_close(one, other, rtol=0, atol=1e-12)
        of_cells = operators.cells(x, text).permute(0, 3, 1, 2)
        assert torch.equal(of_cells, histograms(x, s))
