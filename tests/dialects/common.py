"""Photographs, all presets with cells of 8, and the distance of two."""

from __future__ import annotations

import numpy as np
import torch
from skimage import data
from torch import Tensor

from nablahog.cli.arguments.preset_parameters import PRESETS
from nablahog.cli.inputs.spec import SpecOptions
from nablahog.dialects.common_form import CommonForm, Orientations
from nablahog.dialects.describer import Describer
from nablahog.dialects.distances import Distance, Query, distances
from nablahog.hog import HOGSpec, hog

SPECS = {name: SpecOptions(name, cell=(8, 8)).spec() for name in PRESETS}
CAT = torch.from_numpy(data.chelsea()[40:232:4, 60:356:4].transpose(2, 0, 1).copy())  # 48x74: no whole cells


def distance(a: HOGSpec, b: HOGSpec, form: CommonForm | None = None, image: Tensor = CAT) -> Distance:
    describer = Describer(image)
    (result,) = distances(describer, [Query(describer, a, b, form or Orientations())])
    return result


def total(result: Distance) -> float:
    return sum(each.value for each in result.contributions)


def percent(result: Distance) -> dict[str, int]:
    """Shares that are not 0 in whole percent."""
    whole = result.distance**2
    rounded = {each.convention.name: round(100 * each.value / whole) for each in result.contributions}
    return {name: share for name, share in rounded.items() if share}


def photograph(name: str) -> Tensor:
    """(C, H, W), uint8, as scikit-image has it."""
    levels = getattr(data, name)()
    return torch.from_numpy(np.atleast_3d(levels).transpose(2, 0, 1).copy())


def entries(name: str, spec: HOGSpec) -> Tensor:
    """The descriptor (rows, cols, channels) of the photograph, in float64."""
    return hog(photograph(name)[None].double() / 255, spec)[0]
