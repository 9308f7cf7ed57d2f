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

FOLDER = Path(__file__).parent
PEERS = ("dlib", "maskfeat", "opencv", "skimage", "vlfeat", "voc_dpm")


@dataclass(frozen=True)
class Case:
    """What a program found for one image with some parameters, by the program's own names."""

    peer: str
    number: int
    image_name: str
    parameters: dict[str, Any]
    output: npt.NDArray[np.float32]

    @property
    def pixels(self) -> npt.NDArray[np.uint8]:
        """(height, width) or (height, width, 3)."""
        return archive("images")[self.image_name]

    @property
    def image(self) -> Tensor:
        """uint8 (1, channels, height, width)."""
        return torch.from_numpy(np.atleast_3d(self.pixels)).permute(2, 0, 1).unsqueeze(0)

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
    return [
        Case(peer, k, parameters.pop("image"), parameters, arrays[f"output_{k}"])
        for k, parameters in enumerate(json.loads(str(arrays["cases"])))
    ]
