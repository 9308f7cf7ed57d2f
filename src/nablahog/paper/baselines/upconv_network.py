"""A feed-forward network from descriptors to images, of convolutions and up-convolutions.

Of the kind of Dosovitskiy and Brox, *Inverting Visual Representations with Convolutional Networks*, CVPR 2016
(arXiv:1506.02753): the cells of a descriptor are the pixels of an image of as many channels; convolutions shrink it, so
that each cell knows of distant ones, and up-convolutions, each twice as fine with half the channels, enlarge it to the
image; leaky ReLUs of slope 0.2.

Different here: gray images, not colour; sizes to train on a CPU, 4.2 million weights for UoCTTI with cells of 8; and a
channel that tells the scale of descriptors which are not normalised to a fixed one.  The number of layers is our own
choice, too: one stream of convolutions shrinks the cells by 4 and enlarges them again, another keeps their resolution,
and both go into the up-convolutions to pixels.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from ...hog.normalizers import Footprint
from ...hog.spec import HOGSpec
from ...invert.prior_network import set_to_zero

SLOPE = 0.2  # of leaky ReLUs
MEAN = 0.5  # of gray values in 0…1, about
LARGEST_WIDTH = 1024
CELLS = (2, 4, 8, 16)  # sides of cells in pixels, powers of two
_DESCRIPTOR = 5.0  # scales entries of a four-block descriptor to about 1


def default_widths(spec: HOGSpec) -> tuple[int, ...]:
    """256 channels of cells, and half as many at each doubling.

    Raises:
        ValueError: there can be no such network for descriptors of ``spec``.
    """
    check_dialect(spec)
    return tuple(256 >> k for k in range(spec.cell_size[0].bit_length()))


def check_dialect(spec: HOGSpec) -> None:
    """Raises ValueError unless descriptors have an entry for each cell alone, and cells are squares of such a side."""
    if any(spec.normalizer.footprint(axis) != Footprint() for axis in (0, 1)):
        raise ValueError(f"this network can be learned for descriptors of single cells only, unlike {spec.name}")
    height, width = spec.cell_size
    if height != width or height not in CELLS:
        sides = ", ".join(map(str, CELLS))
        raise ValueError(f"this network can be learned for square cells of {sides} pixels only, got {height}x{width}")


def check_widths(spec: HOGSpec, widths: tuple[int, ...]) -> None:
    """Raises ValueError unless there can be a network of these widths for descriptors of ``spec``."""
    check_dialect(spec)
    side = spec.cell_size[0]
    if not all(type(width) is int and 1 <= width <= LARGEST_WIDTH for width in widths):
        raise ValueError(f"widths must be integers of 1 … {LARGEST_WIDTH}, got {widths}")
    if 2 ** (len(widths) - 1) != side:
        raise ValueError(f"{len(widths)} widths do not lead from cells of {side} pixels to pixels")


def input_channels(spec: HOGSpec) -> int:
    """Of :func:`network_input`."""
    return spec.channels + (not spec.normalizer.bounded)


def network_input(descriptor: Tensor, spec: HOGSpec, height: int, width: int) -> Tensor:
    """The input for descriptors (B, rows, cols, channels), float32, of images of ``height`` x ``width`` pixels.

    Returns:
        (B, :func:`input_channels`, R, C) for the R x C cells that cover the image; the outermost cells are repeated
        where the descriptor has fewer.
    """
    cell = spec.cell_size[0]
    entries = descriptor.permute(0, 3, 1, 2)
    if spec.normalizer.bounded:
        entries = entries * _DESCRIPTOR
    else:  # their scale is arbitrary
        size = entries.square().mean(dim=(1, 2, 3), keepdim=True).sqrt()
        entries = entries / torch.where(size > 0, size, 1)
        entries = torch.cat([entries, _scale(descriptor).expand(-1, 1, *entries.shape[2:])], dim=1)
    bottom, right = (-(-n // cell) - cells for n, cells in zip((height, width), entries.shape[2:], strict=True))
    return pad(entries, (0, right, 0, bottom), mode="replicate") if bottom or right else entries


def _scale(descriptor: Tensor) -> Tensor:
    """√(rms(d) ‖d‖), (B, 1, 1, 1): of d = h / √‖h‖, Eq. 7 as printed, the root of the rms of the histograms h."""
    squares = descriptor.square().flatten(1)
    return (squares.mean(1) * squares.sum(1)).sqrt().sqrt().view(-1, 1, 1, 1)


class UpconvNetwork(nn.Module):
    """From :func:`network_input` (B, channels, R, C) to images (B, 1, R · c, C · c); all 0.5 before training.

    Args:
        spec: the dialect.
        widths: channels at each resolution from cells to pixels, as :func:`check_widths` allows.
    """

    def __init__(self, spec: HOGSpec, widths: tuple[int, ...]) -> None:
        super().__init__()
        channels, width = input_channels(spec), widths[0]
        half = max(1, width // 2)
        self.far = nn.Sequential(
            *_conv(channels, half, 3, stride=2),
            *_conv(half, width, 3, stride=2),
            *_conv(width, width, 3),
            *_upconv(width, width),
            *_upconv(width, half),
        )
        self.near = nn.Sequential(*_conv(channels, half, 5), *_conv(half, half, 3))
        body = _conv(2 * half, width, 3)
        for k, (coarse, fine) in enumerate(pairwise(widths)):
            body += _upconv(coarse, fine)
            if k + 2 < len(widths):
                body += _conv(fine, fine, 3)
        self.body = nn.Sequential(*body)
        self.out = nn.Conv2d(widths[-1], 1, 5, padding=2)
        set_to_zero(self.out)

    def forward(self, cells: Tensor) -> Tensor:
        """Images in gray values, 0…1 but for what overshoots."""
        rows, cols = cells.shape[2:]
        both = torch.cat([self.far(cells)[..., :rows, :cols], self.near(cells)], dim=1)
        image: Tensor = MEAN + self.out(self.body(both))
        return image


def _conv(inputs: int, outputs: int, kernel: int, stride: int = 1) -> list[nn.Module]:
    return _activated(nn.Conv2d(inputs, outputs, kernel, stride=stride, padding=kernel // 2))


def _upconv(inputs: int, outputs: int) -> list[nn.Module]:
    return _activated(nn.ConvTranspose2d(inputs, outputs, 4, stride=2, padding=1))


def _activated(layer: nn.Conv2d | nn.ConvTranspose2d) -> list[nn.Module]:
    """With the initial weights of He et al. for leaky ReLUs: their variance is in inverse proportion to the inputs."""
    inputs = layer.in_channels * layer.kernel_size[0] ** 2
    if isinstance(layer, nn.ConvTranspose2d):
        inputs //= layer.stride[0] ** 2
    nn.init.normal_(layer.weight, std=(2 / (1 + SLOPE**2) / inputs) ** 0.5)
    nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return [layer, nn.LeakyReLU(SLOPE)]
