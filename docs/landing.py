"""Makes the three pictures of the site's first page, landing-*.png: `python docs/landing.py`.

The first and the last are parts of readme.png and pose.png, which docs/pictures.py makes. The second is that of
docs/gallery/plot_train_loss.py: an image with the colours of a thumbnail and the HOG of a photograph.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from skimage import data
from torch.nn.functional import adaptive_avg_pool2d, interpolate, mse_loss

import nablahog

HERE = Path(__file__).parent
SIDE, GAP = 256, 8


def side_by_side(pictures: Sequence[Image.Image]) -> Image.Image:
    """Square pictures in one row, on white."""
    row = Image.new("RGB", (len(pictures) * (SIDE + GAP) - GAP, SIDE), "white")
    for k, picture in enumerate(pictures):
        row.paste(picture.resize((SIDE, SIDE), Image.Resampling.LANCZOS), (k * (SIDE + GAP), 0))
    return row


def parts(name: str, numbers: Sequence[int]) -> list[Image.Image]:
    """Pictures of a contact sheet in one row, without their captions."""
    sheet = Image.open(HERE / name).convert("RGB")
    side, top = 320, sheet.height - 328
    return [sheet.crop((8 + k * (side + 8), top, 8 + k * (side + 8) + side, top + side)) for k in numbers]


def losses() -> list[Image.Image]:
    """A thumbnail, a HOG, and the image that has both."""
    photograph = Image.fromarray(data.astronaut()).crop((90, 0, 346, 256)).resize((128, 128), Image.Resampling.LANCZOS)
    target = torch.from_numpy(np.array(photograph)).permute(2, 0, 1)[None] / 255
    describe = nablahog.HOG(nablahog.presets.uoctti(cell_size=4))
    thumbnail, descriptor = adaptive_avg_pool2d(target, 8), describe(target)
    torch.manual_seed(0)
    start = interpolate(thumbnail, size=(128, 128), mode="bicubic").clamp(0, 1)
    image = (start + 0.005 * torch.randn_like(start)).requires_grad_()
    optimizer = torch.optim.Adam([image], lr=0.03)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, 600)
    for _ in range(600):
        smooth = (image.diff(dim=2) ** 2).mean() + (image.diff(dim=3) ** 2).mean()
        loss = 10 * mse_loss(adaptive_avg_pool2d(image, 8), thumbnail) + mse_loss(describe(image), descriptor)
        optimizer.zero_grad()
        (loss + 0.3 * smooth).backward()
        optimizer.step()
        schedule.step()
    blocks = Image.fromarray(np.uint8(255 * thumbnail[0].permute(1, 2, 0).numpy()))
    result = np.uint8(255 * image.detach().clamp(0, 1)[0].permute(1, 2, 0).numpy())
    return [
        blocks.resize((SIDE, SIDE), Image.Resampling.NEAREST),
        Image.fromarray(np.uint8(255 * nablahog.glyphs(descriptor[0], describe.spec))),
        Image.fromarray(result),
    ]


def main() -> None:
    pictures = {"invert": parts("readme.png", (0, 1, 2)), "train": losses(), "fit": parts("pose.png", (0, 2, 3))}
    for name, row in pictures.items():
        side_by_side(row).save(HERE / f"landing-{name}.png", optimize=True)


if __name__ == "__main__":
    main()
