"""Stored outputs of other programs, see ``README.md``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from nablahog.hog import HOGSpec, presets

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Case:
    """What a program found for one image with some parameters.

    Attributes:
        peer: the name of the file.
        number: of the case in its file.
        image_name: of the image in ``images.npz``.
        parameters: by the program's own names.
        preset: the function of :mod:`nablahog.presets` that describes the same.
        arguments: of the preset.
        precision: in which the program works.
        output: in the program's own layout.
    """

    peer: str
    number: int
    image_name: str
    parameters: dict[str, Any]
    preset: str
    arguments: dict[str, Any]
    precision: str
    output: npt.NDArray[np.float32]

    @property
    def pixels(self) -> npt.NDArray[np.uint8]:
        """(height, width) or (height, width, 3)."""
        return archive("images")[self.image_name]

    @property
    def image(self) -> Tensor:
        """uint8 (1, channels, height, width)."""
        return torch.from_numpy(np.atleast_3d(self.pixels)).permute(2, 0, 1).unsqueeze(0)

    @property
    def spec(self) -> HOGSpec:
        pairs = {name: tuple(value) if isinstance(value, list) else value for name, value in self.arguments.items()}
        spec: HOGSpec = getattr(presets, self.preset)(**pairs)
        return spec

    @property
    def dtype(self) -> torch.dtype:
        dtype: torch.dtype = getattr(torch, self.precision)
        return dtype

    @property
    def stored(self) -> Tensor:
        """The output in the shape of ``layout="native"``: of OpenCV five axes are stored, of which it makes one."""
        output = torch.from_numpy(self.output)
        return output.flatten() if self.spec.layout == "opencv-vector" else output

    def __str__(self) -> str:
        return f"{self.peer}-{self.number}-{self.image_name}"


@cache
def archive(name: str) -> dict[str, npt.NDArray[Any]]:
    """All arrays of one file."""
    with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as stored:
        return {key: stored[key] for key in stored.files}


@cache
def cases(peer: str) -> list[Case]:
    """All cases of one program."""
    arrays = archive(peer)
    found = []
    for k, parameters in enumerate(json.loads(str(arrays["cases"]))):
        image, preset, arguments = (parameters.pop(name) for name in ("image", "preset", "arguments"))
        precision = parameters.pop("precision", "float32")
        found.append(Case(peer, k, image, parameters, preset, arguments, precision, arrays[f"output_{k}"]))
    return found


PEERS = tuple(sorted(path.stem for path in FOLDER.glob("*.npz") if "output_0" in archive(path.stem)))
"""The programs whose descriptors are stored, by the names of their files."""
