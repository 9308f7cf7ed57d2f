"""Descriptors of the image shrunk, as multi-scale-more is given them."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck
from torch.nn.functional import avg_pool2d
from torch.testing import assert_close

from nablahog import hog, presets, reconstruct_multiscale
from nablahog.hog import HOGSpec
from nablahog.invert import Search, multiscale, scale_descriptors
from nablahog.invert.coarser import CoarserDescriptor

from .photographs import photograph

SPECS = {"paper": presets.paper(4), "uoctti": presets.uoctti(4)}
every_spec = pytest.mark.parametrize("spec", SPECS.values(), ids=SPECS)


def _images() -> Tensor:
    return torch.cat([photograph(32, name) for name in ("camera", "coins")]).double()


def _prior(images: Tensor, spec: HOGSpec, factor: int = 2) -> CoarserDescriptor:
    return CoarserDescriptor(0.7, hog(avg_pool2d(images, factor), spec), spec, factor)


@every_spec
def test_is_the_relative_distance(spec: HOGSpec) -> None:
    images, given = _images(), _images().flip(2)
    target = hog(avg_pool2d(given, 2), spec)
    apart = (hog(avg_pool2d(images, 2), spec) - target).flatten(1).norm(dim=1) / target.flatten(1).norm(dim=1)
    prior = _prior(given, spec)
    assert_close(prior(images), 0.7 * apart.square())
    assert_close(prior.residuals(images).square().sum(dim=1), prior(images))
    assert_close(_prior(images, spec)(images), torch.zeros(2, dtype=torch.float64), atol=1e-12, rtol=0)


@every_spec
def test_derivative(spec: HOGSpec) -> None:
    images = torch.rand(2, 1, 16, 16, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    prior = _prior(images.flip(2), spec)
    assert gradcheck(prior, (images.requires_grad_(),))
    assert gradcheck(prior.residuals, (images,))


def test_of_some_images_of_a_batch() -> None:
    images, prior = _images(), _prior(_images().flip(2), SPECS["paper"])
    second = torch.tensor([1])
    assert_close(prior.of(second)(images[1:]), prior(images)[1:])
    assert_close(prior.of(slice(1))(images[:1]), prior(images)[:1])


def test_without_texture() -> None:
    images = _images()
    prior = _prior(torch.full_like(images, 0.5), SPECS["paper"])
    assert torch.equal(prior(images), torch.zeros(2, dtype=torch.float64))
    assert torch.equal(prior.residuals(images), torch.zeros_like(prior.residuals(images)))


@every_spec
def test_the_last_level_has_the_descriptors_of_all(spec: HOGSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    images, scales = torch.cat([photograph(64), photograph(64, "coins")]), (16, 4, 1)
    descriptors = scale_descriptors(images, spec, scales)
    apart = []
    for weight in (0.0, 0.1):
        monkeypatch.setattr(multiscale, "COARSER_WEIGHT", weight)
        search = Search(max_evaluations=60)
        last = reconstruct_multiscale(descriptors, spec, scales=scales, search=search)[-1].reconstruction
        found = scale_descriptors(last.image, spec, scales)
        each = [
            (a - b).flatten(1).norm(dim=1) / b.flatten(1).norm(dim=1) for a, b in zip(found, descriptors, strict=True)
        ]
        apart.append(torch.stack(each[:-1]).mean())
    assert apart[1] < 0.8 * apart[0]
