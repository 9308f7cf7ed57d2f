"""Makes the pictures in docs/ from photographs that scikit-image installs: `python docs/pictures.py`.

preimages.png: eight photographs of 128x128, their UoCTTI glyphs, pre-images and differences.
scales.png: the multi-scale variants of the paper's descriptor, level by level.
readme.png: one photograph of 256x256.
pose.png, pose-similarity.svg: a chair in front of one, with the pose found, and similarity by azimuth.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from skimage import data
from torch import Tensor

from nablahog import hog, metrics, presets, reconstruct
from nablahog.cli.results.pose_page import HEIGHT, overlay, similarity_by_azimuth
from nablahog.hog.gradient import gray
from nablahog.invert import reconstruct_multiscale, scale_descriptors
from nablahog.io.images import SAMPLE_NAMES, limit_size, sample_photograph
from nablahog.paper.annotations import sample_viewpoints
from nablahog.paper.examples import render_examples
from nablahog.paper.scenes import CHAIRS
from nablahog.pose import estimate_pose
from nablahog.pose.crop import crop_object
from nablahog.pose.photograph import PreparedPhotograph
from nablahog.render.models import archived_models
from nablahog.viz.pictures import Panel, contact_sheet, difference, glyphs

HERE = Path(__file__).parent
NAMES = ("astronaut", "camera", "chelsea", "coffee", "rocket", "coins", "clock", "brick")


def photograph(name: str, size: int) -> Tensor:
    """(1, 1, size, size), gray, in 0…1: the middle square, shrunk."""
    picture = torch.from_numpy(getattr(data, name)())
    picture = picture.permute(2, 0, 1)[:3] if picture.dim() == 3 else picture[None]
    side = min(picture.shape[1:])
    top, left = ((n - side) // 2 for n in picture.shape[1:])
    return gray(limit_size(picture[:, top : top + side, left : left + side] / 255, size)[None])


def scales() -> None:
    spec = presets.paper(cell_size=8)
    names = ("astronaut", "coffee", "rocket")
    images = torch.cat([photograph(name, 128) for name in names])
    variants = {
        "multi-scale": reconstruct_multiscale(hog(images, spec), spec, prior=None),
        "multi-scale-more": reconstruct_multiscale(scale_descriptors(images, spec), spec, prior=None),
    }
    rows = []
    for i, name in enumerate(names):
        row = [Panel(images[i, 0], name)]
        for variant, levels in variants.items():
            for level in levels:
                height, width = level.reconstruction.image.shape[2:]
                enlarged = (
                    level.reconstruction.image[i].repeat_interleave(128 // height, 1).repeat_interleave(128 // width, 2)
                )
                row.append(Panel(enlarged[0], f"{variant}, 1/{level.scale}"))
        rows.append(row)
    contact_sheet(rows, height=128).convert("L").save(HERE / "scales.png", optimize=True)


def pose() -> None:
    models = archived_models(CHAIRS)
    viewpoints = sample_viewpoints(10_000, np.random.default_rng(0))
    clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
    scenes = render_examples(6, models, viewpoints, clutter, origin="", unknown_model=False, seed=0).objects
    one = scenes[-1]
    meshes = {model.name: model.mesh() for model in one.candidates}
    estimate = estimate_pose(one.image, meshes, box=one.box, initial=one.initial)
    mesh = meshes[estimate.model]
    print(f"pose.png: azimuth {estimate.azimuth:.1f} for {one.azimuth:.1f}")
    contact_sheet([overlay(one.image, estimate, mesh)], HEIGHT).save(HERE / "pose.png", optimize=True)
    section = similarity_by_azimuth(PreparedPhotograph(crop_object(one.image, estimate.box)), estimate, mesh)
    (HERE / "pose-similarity.svg").write_text(section.drawings[0].svg(), encoding="utf-8")


def main() -> None:
    pose()
    scales()
    spec = presets.uoctti(cell_size=8)
    images = torch.cat([photograph(name, 128) for name in NAMES])
    descriptors = hog(images, spec)
    pre_images = reconstruct(descriptors, spec)
    rows = []
    for name, image, descriptor, pre_image in zip(NAMES, images, descriptors, pre_images.image, strict=True):
        pair = pre_image[0], image[0]
        caption = f"CC {metrics.cross_correlation(*pair):.2f}, SSIM {metrics.ssim(*pair):.2f}"
        rows.append(
            [
                Panel(image[0], name),
                Panel(glyphs(descriptor, spec), "UoCTTI HOG"),
                Panel(pre_image[0], caption),
                Panel(difference(*pair), "difference"),
            ]
        )
    paired = [left + right for left, right in zip(rows[::2], rows[1::2], strict=True)]
    contact_sheet(paired, height=192).convert("L").save(HERE / "preimages.png", optimize=True)

    image = photograph("astronaut", 256)
    descriptor = hog(image, spec)
    pre_images = reconstruct(descriptor, spec)
    drawn = Panel(glyphs(descriptor[0], spec), "its HOG (UoCTTI, cells of 8 pixels)")
    panels = [Panel(image[0], "a photograph"), drawn, Panel(pre_images.image[0], "pre-image, from the HOG alone")]
    contact_sheet([panels], height=320).convert("L").save(HERE / "readme.png", optimize=True)


if __name__ == "__main__":
    main()
