"""Every entry of the Jacobian against central differences, as a table; a report, so the exit status is always 0.

The error is  max |analytic - central| / max |central|,  both over all entries of the Jacobian but those of left-out
pixels.  Central differences are of fourth order, in float64.

Left out, and reported in columns of their own, are the pixels whose neighbours have a gradient on a kink, where a
difference and a derivative are different things: a zero gradient, the boundary of a hard bin; and those so near to a
kink that the differences step over it.  Gradients exactly on the centre of a linear bin stay in: there the operator
returns the mean of the one-sided derivatives, which is what central differences tend to (docs/derivatives.md).
"""

from __future__ import annotations

import argparse
import math

import skimage.data
import torch
from torch import Tensor

from nablahog.hog import HOGSpec, hog, presets
from nablahog.hog.gradient import gradient

STEP = 1e-7  # of images in 0…1; rounding then costs 1e-9, truncation less, down to gradients of 1e-5
REACH = 4 * STEP  # farther from a kink than this in the gradient, no difference steps over it

SPECS: dict[str, HOGSpec] = {
    "paper, printed": presets.paper(),
    "paper, robust": presets.paper(global_form="robust"),
    "UoCTTI, linear": presets.uoctti(),
    "UoCTTI, hard": presets.uoctti(vote="hard"),
}


def images(side: int) -> dict[str, Tensor]:
    """The images of the table, (1, 1, side, side) in 0…1."""
    generator = torch.Generator().manual_seed(0)
    top, left = 60, 230  # hair before sky: an edge, texture, and a tenth of the pixels flat
    crop = torch.from_numpy(skimage.data.camera()[top : top + side, left : left + side].copy())
    photo = crop.double().view(1, 1, side, side) / 255
    noise = torch.rand(photo.shape, generator=generator, dtype=torch.float64)
    return {"random": noise, "photo, 8 bit": photo, "photo + 1e-3 noise": photo + 1e-3 * (noise - 0.5)}


def next_to_kink(image: Tensor, spec: HOGSpec) -> Tensor:
    """Pixels (side, side) that take part in a gradient on or near a kink of the votes."""
    gx, gy = (g[0] / spec.value_range for g in gradient(image * spec.value_range, spec))
    norm = torch.hypot(gx, gy)
    position = torch.atan2(gy, gx) * (spec.bins / spec.period) - spec.bin_offset
    if spec.vote == "hard":
        off, at_kink = ((position - 0.5) - (position - 0.5).round()).abs(), True
    else:
        off, at_kink = (position - position.round()).abs(), False
    distance = norm * off * (spec.period / spec.bins)
    kink = (norm <= REACH) | ((distance <= REACH) & ((off > 1e-12) | at_kink))
    if spec.border == "ignore":
        kink[[0, -1]] = False
        kink[:, [0, -1]] = False
    side = torch.nn.functional.pad(kink, (1, 1, 1, 1))
    return side[1:-1, :-2] | side[1:-1, 2:] | side[:-2, 1:-1] | side[2:, 1:-1]


def central(image: Tensor, spec: HOGSpec) -> Tensor:
    """The Jacobian (entries, pixels) by differences."""
    columns = []
    for basis in torch.eye(image.numel(), dtype=image.dtype).view(-1, *image.shape[1:]).split(128):

        def ahead(steps: int, basis: Tensor = basis) -> Tensor:
            return hog(image + steps * STEP * basis, spec).flatten(1)

        columns.append((8 * (ahead(1) - ahead(-1)) - (ahead(2) - ahead(-2))) / (12 * STEP))
    return torch.cat(columns).T


def jacobian_reverse(image: Tensor, spec: HOGSpec) -> Tensor:
    """The Jacobian (entries, pixels), entry by entry."""
    jacobian: Tensor = torch.func.jacrev(lambda z: hog(z, spec), chunk_size=128)(image)
    return jacobian.reshape(-1, image.numel())


def jacobian_forward(image: Tensor, spec: HOGSpec) -> Tensor:
    """The Jacobian (entries, pixels), pixel by pixel."""

    def column(tangent: Tensor) -> Tensor:
        changes: Tensor = torch.func.jvp(lambda z: hog(z, spec), (image,), (tangent,))[1]
        return changes.flatten()

    basis = torch.eye(image.numel(), dtype=image.dtype).view(-1, *image.shape)
    return torch.func.vmap(column, chunk_size=128)(basis).T


def error(analytic: Tensor, numeric: Tensor) -> str:
    if not numeric.numel():
        return "–"
    size = numeric.abs().max().item()
    return f"{(analytic - numeric).abs().max().item() / size:.1e}" if size else "–"


def main() -> None:
    parser = argparse.ArgumentParser(description="Derivatives of the HOG operator against central differences.")
    parser.add_argument("--side", type=int, default=32, help="pixels of a side of the square images (default 32)")
    parser.add_argument("--threads", type=int, default=1, help="threads of PyTorch (default 1)")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)

    print(f"PyTorch {torch.__version__}, float64, {arguments.side}x{arguments.side} pixels, step {STEP:g}\n")
    print("| descriptor | image | reverse mode | forward mode | on bin centres | left out | error there |")
    print("|---|---|---:|---:|---:|---:|---:|")
    for name, spec in SPECS.items():
        for kind, image in images(arguments.side).items():
            numeric = central(image, spec)
            reverse = jacobian_reverse(image, spec)
            forward = jacobian_forward(image, spec)
            out = next_to_kink(image, spec).flatten()
            gx, gy = (g[0] for g in gradient(image, spec))
            centred = (gx == 0) != (gy == 0) if spec.vote == "linear" else torch.zeros_like(gx, dtype=torch.bool)
            centred &= (gx if math.isclose(spec.bin_offset, 0.5) else gy) == 0
            print(
                f"| {name} | {kind} | {error(reverse[:, ~out], numeric[:, ~out])} "
                f"| {error(forward[:, ~out], numeric[:, ~out])} | {centred.double().mean():.1%} "
                f"| {out.double().mean():.1%} | {error(reverse[:, out], numeric[:, out])} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
