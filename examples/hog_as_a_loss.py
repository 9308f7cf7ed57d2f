"""HOG as a loss beside another one: a tiny thumbnail has the colours, a HOG the edges, and an image is sought for both.

python examples/hog_as_a_loss.py photo.jpg --out hog_as_a_loss.png
"""

import argparse
from collections.abc import Sequence

import numpy as np
import torch
from PIL import Image
from skimage import data
from torch.nn.functional import adaptive_avg_pool2d, interpolate, mse_loss

import nablahog


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photograph", nargs="?", help="by default a photograph that comes with scikit-image")
    parser.add_argument("--out", default="hog_as_a_loss.png", help="the picture to write")
    parser.add_argument("--size", type=int, default=192, help="pixels of a side")
    parser.add_argument("--steps", type=int, default=300)
    arguments = parser.parse_args(argv)

    side = arguments.size
    photograph = Image.open(arguments.photograph) if arguments.photograph else Image.fromarray(data.astronaut())
    photograph = photograph.convert("RGB").resize((side, side), Image.Resampling.LANCZOS)
    target = torch.from_numpy(np.array(photograph)).permute(2, 0, 1)[None].float() / 255  # (1, 3, H, W)

    describe = nablahog.HOG(nablahog.presets.uoctti(cell_size=4))  # a module, as any other layer
    thumbnail = adaptive_avg_pool2d(target, side // 16)
    descriptor = describe(target)

    enlarged = interpolate(thumbnail, size=(side, side), mode="bicubic").clamp(0, 1)
    torch.manual_seed(0)
    image = (enlarged + 0.02 * torch.randn_like(enlarged)).requires_grad_()
    optimizer = torch.optim.Adam([image], lr=0.01)
    for step in range(arguments.steps + 1):
        of_colours = mse_loss(adaptive_avg_pool2d(image, side // 16), thumbnail)
        of_edges = mse_loss(describe(image), descriptor)
        smooth = (image.diff(dim=2) ** 2).mean() + (image.diff(dim=3) ** 2).mean()
        loss = 10 * of_colours + of_edges + 0.05 * smooth
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step % 50 == 0:
            errors = f"colours {float(of_colours.detach()):.6f}, edges {float(of_edges.detach()):.6f}"
            print(f"step {step:3}: {errors}, photograph {float(mse_loss(image.detach(), target)):.4f}")

    pictures = [interpolate(thumbnail, size=(side, side)), enlarged, image.detach().clamp(0, 1), target]
    sheet = torch.cat(pictures, dim=3)[0].permute(1, 2, 0).numpy()
    Image.fromarray(np.uint8(255 * sheet)).save(arguments.out)


if __name__ == "__main__":
    main()
