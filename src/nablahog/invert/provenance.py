"""Which images something was learned from."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

import numpy as np
from torch import Tensor


def digest_of_images(names: Sequence[str], images: Mapping[str, Tensor]) -> str:
    """The SHA-256 of the names, sizes and pixels of images (H, W), in the order of ``names``, hexadecimal."""
    digest = hashlib.sha256()
    for name in names:
        digest.update(f"{name}\0{tuple(images[name].shape)}\0".encode(errors="backslashreplace"))
        digest.update(np.ascontiguousarray(images[name].numpy()).tobytes())
    return digest.hexdigest()
