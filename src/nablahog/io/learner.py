"""How models are learned from photographs and saved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from torch import Tensor

from ..hog.spec import HOGSpec
from .files import checkpoint_for
from .learned_model import LearnedModel

Progress: TypeAlias = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Learner:
    """How a kind of model is learned.

    Attributes:
        model: its class.
        learn: from gray photographs (H, W), float32 in 0…1, by name, and a spec, to a model.  Its keyword arguments are
            ``progress``, ``checkpoint``, a file from which an interrupted learning is resumed, and its own.
        check: raises ValueError for a spec that it cannot be learned for.
        least: (height, width) of the smallest image.
        tile: pixels of the side of all images; None if it is free.
    """

    model: type[LearnedModel]
    learn: Callable[..., LearnedModel]
    check: Callable[[HOGSpec], object] = lambda spec: None
    least: Callable[[HOGSpec], tuple[int, int]] = lambda spec: spec.cell_size
    tile: int | None = None

    def learn_to(
        self, output: Path, images: Mapping[str, Tensor], spec: HOGSpec, progress: Progress, **options: Any
    ) -> LearnedModel:
        """Learns a model and saves it in the file ``output``, with a checkpoint beside it meanwhile."""
        with checkpoint_for(output) as checkpoint:
            model = self.learn(images, spec, progress=progress, checkpoint=checkpoint, **options)
            model.save(output)
        return model
