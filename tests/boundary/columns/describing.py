"""From images to descriptors, and pictures and layouts of these."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

import nablahog
from nablahog import HOG, HOGLoss, glyphs, hog, metrics, presets
from nablahog.compat import skimage
from nablahog.compat.opencv import HOGDescriptor, score
from nablahog.compat.sklearn import HOGTransformer
from nablahog.hog.box import cell_centres, pixel_box

from ..table import Use, column
from .plain import (
    BATCH,
    BOX,
    DESCRIPTOR,
    IMAGE,
    OTHER,
    SIZE,
    SMALL,
    angle,
    as_batch,
    as_bytes,
    batch,
    image,
    name,
    number,
    size,
)

NATIVE = hog(SMALL, "vlfeat", layout="native")


def streamed(x: Any, spec: Any = "uoctti", memory: Any = 2**16) -> Any:
    return np.concatenate([strip.descriptor for strip in nablahog.stream(x, spec, memory=memory)])


def opencv(**more: Any) -> HOGDescriptor:
    settings: dict[str, Any] = {
        "_winSize": (32, 32),
        "_blockSize": (16, 16),
        "_blockStride": (8, 8),
        "_cellSize": (8, 8),
        "_nbins": 9,
        **more,
    }
    return HOGDescriptor(*settings.values())


def detector() -> HOGDescriptor:
    descriptor = HOGDescriptor((40, 48), (16, 16), (8, 8), (8, 8), 9)
    descriptor.setSVMDetector(np.linspace(-1, 1, descriptor.getDescriptorSize() + 1, dtype=np.float32))
    return descriptor


def detected(threshold: Any) -> Any:
    return [*detector().detect(as_bytes(IMAGE), threshold)]


def transformed(x: Any, spec: Any = "uoctti", **more: Any) -> Any:
    return HOGTransformer(spec, **more).fit_transform(x)


def saved(descriptor: Any, spec: Any = "uoctti", image_size: Any = SIZE) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "d.npz")
        nablahog.save_descriptor(path, descriptor, spec, image_size)
        stored = nablahog.load_descriptor(path)
        return stored.descriptor, stored.image_size


LOSS = HOGLoss("uoctti")  # torch.export traces its use, not how it is made


def loss_of(x: Any, spec: Any = "uoctti") -> Any:
    return HOGLoss(spec)(x, as_batch(OTHER))


COLUMNS = [
    column(
        "hog",
        batch=batch(lambda x: hog(x, "uoctti")),
        image=image(lambda x: hog(x, "uoctti")),
        name=name(lambda n: hog(IMAGE, n)),
        traceable=True,
    ),
    column(
        "HOG",
        batch=batch(lambda x: HOG("uoctti")(x)),
        image=image(lambda x: HOG("uoctti", layout="native")(x)),
        name=name(lambda n: HOG(n)(IMAGE)),
        traceable=True,
    ),
    column(
        "HOGLoss",
        batch=batch(lambda x: LOSS(x, BATCH.flip(0)[: len(x) if hasattr(x, "__len__") else 2])),
        image=image(loss_of, as_batch),
        name=name(lambda n: loss_of(as_batch(IMAGE), n)),
        traceable=True,
        types=(torch.Tensor,),
    ),
    column(
        "stream",
        image=image(streamed),
        number=number(lambda n: streamed(IMAGE, memory=n), 2**15),
        name=name(lambda n: streamed(IMAGE, n)),
    ),
    column(
        "presets",
        size=size(lambda s: hog(IMAGE, presets.paper(cell_size=s)), (8, 6)),
        number=number(lambda n: hog(IMAGE, presets.paper(bins=n)), 7),
        angle=angle(lambda a: hog(IMAGE, presets.paper(epsilon=a)), 2.0),
    ),
    column(
        "presets.opencv",
        size=size(lambda s: hog(IMAGE, presets.opencv(block_size=s)), (16, 16)),
        number=number(lambda n: hog(IMAGE, presets.opencv(nbins=n)), 7),
    ),
    column(
        "glyphs",
        descriptor=Use(lambda d: glyphs(d, "uoctti", 6), DESCRIPTOR[0]),
        number=number(lambda n: glyphs(DESCRIPTOR[0], "uoctti", n), 6),
        name=name(lambda n: glyphs(DESCRIPTOR[0], n, 6)),
    ),
    column(
        "to_layout",
        descriptor=Use(lambda d: nablahog.to_layout(d, "vlfeat"), hog(SMALL, "vlfeat")),
        name=name(lambda n: nablahog.to_layout(DESCRIPTOR, n)),
        traceable=True,
    ),
    column(
        "from_layout",
        descriptor=Use(lambda d: nablahog.from_layout(d, "vlfeat", SIZE), NATIVE),
        size=size(lambda s: nablahog.from_layout(NATIVE, "vlfeat", s)),
        name=name(lambda n: nablahog.from_layout(hog(SMALL, "uoctti", layout="native"), n, SIZE)),
        traceable=True,
    ),
    column(
        "save_descriptor",
        descriptor=Use(saved, DESCRIPTOR[0]),
        size=size(lambda s: saved(DESCRIPTOR[0], image_size=s)),
        name=name(lambda n: saved(DESCRIPTOR[0], n)),
    ),
    column(
        "cells",
        size=size(lambda s: [*cell_centres(presets.uoctti(), s)], (48, 40)),
        box=Use(lambda b: pixel_box(presets.uoctti(), (320, 320), b), BOX),
    ),
    column(
        "metrics",
        image=image(lambda x: metrics.ssim(x, OTHER)),
        angle=angle(lambda a: metrics.azimuth_error(a, 10), 30.0),
        number=number(lambda n: metrics.mutual_information(IMAGE, OTHER, bins=n), 16),
    ),
    column(
        "metrics of views",
        number=number(lambda n: metrics.view([0.0, 44, 46, 350], n), 4),
        angle=angle(lambda a: metrics.near_view(a, 31, 8), 30.0),
    ),
    column(
        "compat.skimage",
        image=image(lambda x: skimage.hog(x, channel_axis=-1 if getattr(x, "ndim", 2) == 3 else None)),
        size=size(lambda s: skimage.hog(IMAGE, pixels_per_cell=s), (8, 6)),
        number=number(lambda n: skimage.hog(IMAGE, orientations=n), 7),
        types=(),
    ),
    column(
        "compat.opencv",
        image=image(lambda x: opencv().compute(x), as_bytes),
        size=size(lambda s: opencv(_winSize=s).compute(as_bytes(IMAGE)), (32, 40)),
        number=number(lambda n: opencv(_nbins=n).compute(as_bytes(IMAGE)), 7),
        angle=angle(detected, 2.0),
        types=(),
    ),
    column("compat.opencv.score", batch=batch(lambda x: score(x, detector())), tolerance=1e-4, types=(torch.Tensor,)),
    column(
        "compat.sklearn",
        batch=batch(transformed, lambda x: x[:, 0].numpy()),
        image=image(lambda x: transformed([x, x])),
        size=size(lambda s: transformed(SMALL.flatten(1).numpy(), image_size=s)),
        name=name(lambda n: transformed(BATCH[:, 0].numpy(), n)),
        types=(np.ndarray, list),
    ),
]
