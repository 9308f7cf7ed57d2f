"""The operator against stored outputs of the original programs, see ``tests/golden/README.md``."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import pytest
import torch
from torch.testing import assert_close

from nablahog.hog import hog, presets
from nablahog.hog.descriptor import Backend
from tests.golden import PEERS, Case, cases

TOLERANCE = 1e-6  # of descriptors whose entries reach 0.2 … 1: sums of float32 in another order
EVERY = [case for peer in PEERS for case in cases(peer)]
VLFEAT = [case for case in cases("vlfeat") if case.parameters["variant"] == "uoctti"]
every_case = pytest.mark.parametrize("case", EVERY, ids=str)
vlfeat_cases = pytest.mark.parametrize("case", VLFEAT, ids=str)


@pytest.fixture
def dtype(case: Case) -> Iterator[torch.dtype]:
    """The precision that the program works in, as PyTorch's default."""
    before = torch.get_default_dtype()
    torch.set_default_dtype(case.dtype)
    yield case.dtype
    torch.set_default_dtype(before)


@every_case
@pytest.mark.parametrize("backend", ["auto", "torch"])
def test_equals_the_program(case: Case, dtype: torch.dtype, backend: Backend) -> None:
    """In its own precision and layout, by the compiled loops and by the plain steps."""
    result = hog(case.image, case.spec, layout="native", backend=backend)[0]
    assert result.dtype == dtype
    assert result.shape == case.stored.shape
    assert_close(result.float(), case.stored, rtol=0, atol=TOLERANCE)


@every_case
def test_bytes_equal_floats(case: Case) -> None:
    """k/255·255 is k again in float32: no bin depends on which is given."""
    spec = case.spec
    assert torch.equal(hog(case.image, spec), hog(case.image.float() / 255, spec))


@every_case
def test_double_precision_differs_in_rounding_only(case: Case) -> None:
    """Of 8-bit images all gradients are exact in float32, and with them all ties."""
    spec = case.spec
    if spec.gamma == "sqrt":
        pytest.skip("gradients of roots of 8-bit images are not exact in float32")
    double = hog(case.image.double() / 255, spec)
    assert_close(hog(case.image, spec).double(), double, rtol=0, atol=TOLERANCE)


@vlfeat_cases
def test_exact_linear_votes_are_as_near_as_the_stored_arccosine_allows(case: Case) -> None:
    """VLFeat has the weight from a float32 arccosine, which loses digits near the bin centres; hard votes are equal."""
    p = case.parameters
    vote = "linear" if p["bilinearOrientations"] else "hard"
    spec = presets.uoctti(p["cellSize"], vote=vote, orientations=p["numOrientations"])
    expected = torch.from_numpy(case.output).permute(1, 2, 0).unsqueeze(0)
    for image in (case.image, case.image.double() / 255):
        descriptor = hog(image, spec).float()
        assert_close(descriptor, expected, rtol=0, atol=1e-4 if vote == "linear" else TOLERANCE)


@vlfeat_cases
def test_aubrys_channels_are_vlfeats_undirected_ones_but_for_epsilon(case: Case) -> None:
    p, n = case.parameters, case.parameters["numOrientations"]
    vote = "linear" if p["bilinearOrientations"] else "hard"
    nine = presets.aubry(p["cellSize"], vote=vote, orientations=n)
    normalizer = dataclasses.replace(nine.normalizer, epsilon=1e-4)
    descriptor = hog(case.image, dataclasses.replace(nine, value_range=255.0, normalizer=normalizer))
    expected = torch.from_numpy(case.output[2 * n : 3 * n]).permute(1, 2, 0).unsqueeze(0)
    assert_close(descriptor, expected, rtol=0, atol=1e-4 if vote == "linear" else TOLERANCE)


@pytest.mark.parametrize("case", cases("voc_dpm"), ids=str)
def test_seeing_3d_channels_are_dpms_undirected_ones_but_for_epsilon(case: Case) -> None:
    nine = presets.seeing3d(case.parameters["sbin"])
    normalizer = dataclasses.replace(nine.normalizer, epsilon=1e-4)
    descriptor = hog(case.image, dataclasses.replace(nine, value_range=255.0, normalizer=normalizer))
    assert_close(descriptor[0], torch.from_numpy(case.output[..., 18:27]), rtol=0, atol=TOLERANCE)
