"""What must hold of the numbers of a descriptor but for rounding, by which dialects are told from each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..hog.normalizers.base import Identity
from ..hog.steps import split_colours
from ..runtime.pytorch import in_threads
from .candidates import Candidate, Parameters, fit_shape
from .orders import Checked, check_order

CLIPPED = (0.2, 0.4)  # the largest entries of dialects that clip, which tell a factor
ROUNDING = 32  # units in the last place that a sum of entries may be off
STEPS = (1e-2, 1 / 255, 1e-3, 1e-4, 1e-5, 1e-6)  # to which numbers are rounded in files of text, or bytes
COARSEST = 1e-5  # step with which identities still tell dialects from each other
MOST_PARTS = 16  # descriptors in one row, of which is tried whether something exact holds of each
OF_WHOLE_IMAGES = ("skimage", "vlfeat", "dlib")  # presets of which what is exact does not hold across images in one row
MOST_REARRANGED = 2**18  # numbers of a matrix that is tried in other ways
LEAST_KINDS = 32  # different numbers, which tell that they are rounded


def check_identities(array: NDArray[np.floating], candidates: list[Candidate]) -> Checked:
    """Leaves those of which most identities of their normalisers hold, and none fails."""
    tolerance = find_tolerance(array)
    checks = in_threads(lambda k: identities_that_hold(array, candidates[k], tolerance), len(candidates))
    possible = [
        (candidate, holding) for candidate, holding in zip(candidates, checks, strict=True) if holding is not None
    ]
    most = max((len(holding) for _, holding in possible), default=0)
    best = [(candidate, holding) for candidate, holding in possible if len(holding) == most]
    exact = [identity.sentence for identity in best[0][1] if identity.share] if best else []
    remaining = [candidate for candidate, _ in best]
    excluded = [candidate for candidate, holding in possible if len(holding) < most]
    return remaining, excluded, ", and ".join(dict.fromkeys(exact))


def identities_that_hold(array: NDArray[np.floating], candidate: Candidate, tolerance: float) -> list[Identity] | None:
    """The identities that hold, without their errors; None if one does not."""
    spec = candidate.spec.single_colour
    channels = _split_channels(array, candidate)
    holding: list[Identity] = []
    for identity in spec.normalizer.identities(channels, spec.bins, spec.signed, tolerance):
        if not identity.errors.numel():
            continue
        share = float((identity.errors.abs() <= tolerance).double().mean())
        if share < identity.share:
            return None
        if share and not identity.is_bound:
            holding.append(identity._replace(errors=torch.empty(0)))
    return holding


def _split_channels(array: NDArray[np.floating], candidate: Candidate) -> Tensor:
    """The descriptors of an array, those of each colour by themselves, (B, channels, rows, cols)."""
    return split_colours(candidate.descriptors(array), candidate.spec).permute(0, 3, 1, 2)


def find_parts(array: NDArray[np.floating], dialects: Mapping[str, Parameters] | None) -> tuple[list[Candidate], str]:
    """What each of several equal parts of a row is, if something exact holds of each, and that as a clause."""
    names = [name for name in OF_WHOLE_IMAGES if dialects is None or name in dialects]
    for count in range(2, MOST_PARTS + 1) if names else ():
        if array.size % count == 0:
            parts = array.reshape(count, -1)
            fitting = list(fit_shape(parts.shape, None, {name: (dialects or {}).get(name, {}) for name in names}))
            remaining, _, identities = check_identities(parts, [each for each in fitting if each.count == count])
            if identities:
                shape = f"reshape({count}, {parts.shape[1]})"
                sentence = (
                    f"as {count} descriptors in one row, {shape}, they may be {remaining[0].summary}: {identities}"
                )
                return remaining, sentence
    return [], ""


def describe_rearranged(
    array: NDArray[np.floating], size: tuple[int, int] | None, dialects: Mapping[str, Parameters] | None
) -> str:
    """What a matrix may be if it is flattened, transposed or without labels, as a sentence; empty if nothing."""
    matrices = {
        "transposed, .T,": array.T,
        "without its first column": array[:, 1:],
        "without its last column": array[:, :-1],
    }
    for what, rearranged in {"flattened, ravel(),": array.reshape(-1), **matrices}.items():
        checked = rearranged if rearranged.ndim == 1 else rearranged[:MOST_PARTS]
        if checked.size > MOST_REARRANGED or not checked.any() or (checked < 0).any():
            continue
        fitting = fit_shape(rearranged.shape, size, dialects)
        candidates = [each for each in fitting if (each.count > 1) == (rearranged.ndim > 1)]
        remaining, _, identities = check_identities(checked, candidates)
        if identities:
            nearest = check_order(checked, remaining)[0][0]
            return f"{what} it may be {nearest.summary}: {identities}"
    return ""


def find_tolerance(array: NDArray[np.floating]) -> float:
    """How far sums of entries may be off by rounding, of their type or to the step that they show."""
    precision = float(np.finfo(np.float16 if array.dtype == np.float16 else np.float32).eps)
    return ROUNDING * max(precision, find_step(array) / 2)


def find_step(array: NDArray[np.floating]) -> float:
    """The coarsest of the usual steps of which all numbers are multiples, but for their type; 0 if there is none."""
    numbers = np.unique(np.asarray(array, np.float64))
    if len(numbers) < LEAST_KINDS:
        return 0.0
    precision = float(np.finfo(np.float32).eps)
    for step in STEPS:
        multiples = numbers / step
        if (abs(multiples - np.rint(multiples)) <= precision * abs(multiples)).all():
            return step
    return 0.0


def restore(
    array: NDArray[np.floating], checked: NDArray[np.floating], candidates: list[Candidate]
) -> tuple[str, NDArray[np.floating] | None]:
    """What the numbers look like, as a sentence, and the array before it was scaled or reversed, if that holds exactly.

    Only the part that is ``checked`` decides.
    """
    most, restored = 0, None
    for factor in _find_factors(checked, candidates):
        scaled = np.asarray(checked / factor, np.float32)
        remaining, _, identities = check_identities(scaled, candidates)
        holding = identities_that_hold(scaled, remaining[0], find_tolerance(scaled)) if identities else None
        # what adds up does at any scale
        if holding and len(holding) > most and any(identity.has_scale for identity in holding):
            sentence = f"divided by {factor:g} they may be {remaining[0].summary}: {identities}"
            most, restored = len(holding), (sentence, np.asarray(array / factor, np.float32))
    if restored is not None:
        return restored
    remaining, _, identities = check_identities(checked[..., ::-1], candidates)
    if identities:
        return f"in reverse order they may be {remaining[0].summary}: {identities}", array[..., ::-1]
    return "its largest number is exactly 1, as if all were divided by it" if checked.max() == 1 else "", None


def _find_factors(array: NDArray[np.floating], candidates: list[Candidate]) -> Iterable[float]:
    """By what the numbers may have been multiplied, without those that differ by rounding alone."""
    factors = [255.0, *(float(array.max()) / clipped for clipped in CLIPPED)]
    for candidate in {each.spec: each for each in candidates}.values():
        scale = candidate.spec.single_colour.normalizer.scale(_split_channels(array, candidate))
        factors += [] if scale is None else [scale]
    return {f"{factor:.5g}": factor for factor in factors}.values()
