"""HOGSpec: what it refuses, how it is stored; and what ``hog`` refuses."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from nablahog.hog import FourBlockNorm, GlobalNorm, HOGSpec, hog, presets
from nablahog.hog.spec import PARTS

from .zoo import SPECS, spec

PARTS_THERE_ARE = [
    parts
    for n in (1, 2, 3)
    for parts in itertools.combinations(PARTS, n)
    if "directed" in parts or "undirected" in parts
]
positive = st.floats(min_value=0, exclude_min=True, allow_infinity=False)


@st.composite
def specs(draw: st.DrawFn) -> HOGSpec:
    """Any valid spec."""
    normalizer = draw(
        st.one_of(
            st.builds(GlobalNorm, positive, st.sampled_from(["printed", "robust"])),
            st.builds(FourBlockNorm, positive, positive, st.sampled_from(PARTS_THERE_ARE)),
        )
    )
    vote = draw(st.sampled_from(["linear", "hard"]))
    signed = isinstance(normalizer, FourBlockNorm) or draw(st.booleans())
    paired = signed and (vote == "hard" or isinstance(normalizer, FourBlockNorm))
    return HOGSpec(
        name=draw(st.text()),
        value_range=draw(positive),
        colour=draw(st.sampled_from(["gray", "largest"])),
        border=draw(st.sampled_from(["reflect", "replicate", "zero", "ignore"])),
        bins=2 * draw(st.integers(2, 50)) if paired else draw(st.integers(3, 100)),
        signed=signed,
        bin_offset=draw(st.floats(0, 1, exclude_max=True)),
        vote=vote,
        cell_size=draw(st.tuples(st.integers(1, 1000), st.integers(1, 1000))),
        partial_cells=draw(st.sampled_from(["floor", "round", "ceil"])),
        normalizer=normalizer,
    )


# --- JSON ------------------------------------------------------------------------------------------------------------


@given(s=specs())
def test_json_round_trip(s: HOGSpec) -> None:
    text = s.to_json()
    assert "\n" not in text
    assert HOGSpec.from_json(text) == s
    assert hash(HOGSpec.from_json(text)) == hash(s)


@pytest.mark.parametrize("name", SPECS)
def test_json_holds_every_field(name: str) -> None:
    stored = json.loads(SPECS[name].to_json())
    assert set(stored) == {field.name for field in dataclasses.fields(HOGSpec)}
    assert stored["normalizer"]["kind"] == SPECS[name].normalizer.kind


def test_json_without_parts_means_all_of_them() -> None:
    """As version 0.1 wrote it."""
    stored = json.loads(presets.uoctti().to_json())
    del stored["normalizer"]["parts"]
    assert HOGSpec.from_json(json.dumps(stored)) == presets.uoctti()


def changed(**changes: Any) -> str:
    return json.dumps(json.loads(presets.paper().to_json()) | changes)


def without(field: str) -> str:
    return json.dumps({k: v for k, v in json.loads(presets.paper().to_json()).items() if k != field})


@pytest.mark.parametrize(
    "text",
    [
        "",
        "HOG",
        "{",
        "null",
        "5",
        "[]",
        '"paper"',
        "{}",
        changed(surplus=1),
        changed(name=5),
        changed(bins="nine"),
        changed(bins=9.0),
        changed(bins=None),
        changed(cell_size=8),
        changed(cell_size=[8]),
        changed(cell_size=[8.0, 8.0]),
        changed(cell_size=None),
        changed(colour="grey"),
        changed(colour=["gray"]),
        changed(value_range=float("nan")),
        changed(value_range=float("inf")),
        changed(value_range=0),
        changed(bin_offset="0"),
        changed(signed="no"),
        changed(normalizer=None),
        changed(normalizer="global"),
        changed(normalizer={}),
        changed(normalizer={"kind": "unknown"}),
        changed(normalizer={"kind": ["global"]}),
        changed(normalizer={"kind": "global", "epsilon": 0}),
        changed(normalizer={"kind": "global", "surplus": 0}),
        changed(normalizer={"kind": "four-block"}),  # needs signed bins
        changed(normalizer={"kind": "four-block", "parts": ["colour"]}, signed=True, bins=18),
        changed(normalizer={"kind": "four-block", "parts": [["directed"]]}, signed=True, bins=18),
        changed(normalizer={"kind": "four-block", "parts": 3}, signed=True, bins=18),
        *(without(field.name) for field in dataclasses.fields(HOGSpec)),
    ],
)
def test_bad_json_is_a_value_error(text: str) -> None:
    with pytest.raises(ValueError, match=r"\w+ \w+"):
        HOGSpec.from_json(text)


def test_huge_number_in_json_is_a_value_error() -> None:
    with pytest.raises(ValueError, match=r"^value_range must be a finite number above 0"):
        HOGSpec.from_json(changed(value_range=10**400))


# --- fields ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0, -1.0, math.nan, math.inf, "255", None, True])
def test_refuses_value_range(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^value_range must be a finite number above 0, got "):
        spec(value_range=value)


@pytest.mark.parametrize("value", [None, 5, b"paper"])
def test_refuses_name(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^name must be text, got "):
        dataclasses.replace(presets.paper(), name=value)


@pytest.mark.parametrize("field", ["colour", "border", "vote", "partial_cells"])
@pytest.mark.parametrize("value", ["", "Gray", None, 1, []])
def test_refuses_unknown_choices_and_names_the_known(field: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"^{field} must be one of '\w+', .*, got {value!r}".replace("[", r"\[")):
        spec(**{field: value})


@pytest.mark.parametrize("bins", [2, 0, -9, 9.0, "9", None, True])
def test_refuses_bins(bins: Any) -> None:
    with pytest.raises(ValueError, match=r"^bins must be an integer of at least 3, got "):
        spec(bins=bins)


@pytest.mark.parametrize("signed", [0, 1, None, "yes"])
def test_refuses_signed(signed: Any) -> None:
    with pytest.raises(ValueError, match=r"^signed must be True or False, got "):
        spec(signed=signed)


@pytest.mark.parametrize("bin_offset", [1, 1.5, -0.1, math.nan, "0", None])
def test_refuses_bin_offset(bin_offset: Any) -> None:
    with pytest.raises(ValueError, match=r"^bin_offset must lie in \[0, 1\), in bins, got "):
        spec(bin_offset=bin_offset)


@pytest.mark.parametrize("size", [8, (8,), (8, 8, 8), [8, 8], (0, 8), (8, -1), (8.0, 8), (True, 8), None, "88"])
def test_refuses_cell_size(size: Any) -> None:
    with pytest.raises(ValueError, match=r"^cell_size must be a pair \(height, width\) of integers of at least 1, got"):
        spec(cell_size=size)


@pytest.mark.parametrize(
    "changes",
    [
        {"normalizer": FourBlockNorm(), "signed": False, "bins": 8},
        {"normalizer": FourBlockNorm(), "signed": True, "bins": 9},
        {"vote": "hard", "signed": True, "bins": 9},
    ],
)
def test_refuses_bins_without_opposites(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"pair each bin with its opposite: signed must be True and bins even"):
        spec(**changes)


@pytest.mark.parametrize("value", [0, -1e-5, math.nan, math.inf, "small", None])
def test_normalizers_refuse(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^epsilon must be a finite number above 0, got "):
        GlobalNorm(epsilon=value)
    with pytest.raises(ValueError, match=r"^epsilon must be a finite number above 0, got "):
        FourBlockNorm(epsilon=value)
    with pytest.raises(ValueError, match=r"^clip must be a finite number above 0, got "):
        FourBlockNorm(clip=value)


@pytest.mark.parametrize("form", ["", "L2", None])
def test_global_norm_refuses_form(form: Any) -> None:
    with pytest.raises(ValueError, match=r"^form must be one of 'printed', 'robust', got "):
        GlobalNorm(form=form)


@pytest.mark.parametrize(
    "value",
    [(), ("texture",), ("texture", "directed"), ("directed",) * 2, ("colour",), ["directed"], "directed", None, ([],)],
)
def test_refuses_parts(value: Any) -> None:
    with pytest.raises(ValueError, match=r"^parts must be a tuple of 'directed', 'undirected', 'texture', in this "):
        FourBlockNorm(parts=value)


def test_is_immutable() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        presets.paper().bins = 18  # type: ignore[misc]


# --- presets and grid ------------------------------------------------------------------------------------------------


def test_channels() -> None:
    assert presets.paper().channels == 9
    assert presets.paper(bins=12).channels == 12
    assert presets.uoctti().channels == 31
    assert presets.uoctti(orientations=4).channels == 16
    assert presets.aubry().channels == 9
    assert presets.aubry(orientations=4).channels == 4


def test_presets_take_one_cell_size_or_two() -> None:
    assert presets.paper(5) == presets.paper((5, 5))
    assert presets.uoctti((4, 7)).cell_size == (4, 7)
    assert presets.aubry(5) == presets.aubry((5, 5)) == presets.aubry()


@given(pixels=st.integers(1, 500), cell=st.integers(1, 40))
def test_number_of_cells(pixels: int, cell: int) -> None:
    for rule, exact in {
        "floor": math.floor(pixels / cell),
        "round": math.floor((pixels + cell // 2) / cell),
        "ceil": math.ceil(pixels / cell),
    }.items():
        s = spec(cell_size=(cell, 1), partial_cells=rule)
        if exact:
            assert s.grid(pixels, 3) == (exact, 3)
        else:
            with pytest.raises(ValueError, match="at least one cell"):
                s.grid(pixels, 3)


# --- hog's arguments -------------------------------------------------------------------------------------------------


def assert_one_sentence(message: str) -> None:
    assert "\n" not in message
    assert 20 < len(message) < 160


@pytest.mark.parametrize("images", [None, 3, "image", [[0.0]], torch.zeros(8, 8).numpy()])
def test_hog_refuses_what_is_no_tensor(images: Any) -> None:
    with pytest.raises(TypeError, match=r"^images must be a torch tensor \(B, C, H, W\), got \w+$") as error:
        hog(images, presets.paper())
    assert_one_sentence(str(error.value))


@pytest.mark.parametrize("shape", [(), (8,), (8, 8), (3, 8, 8), (1, 1, 3, 8, 8), (1, 0, 8, 8)])
def test_hog_refuses_other_shapes(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"^images must have shape \(B, C, H, W\) with at least one channel") as error:
        hog(torch.zeros(shape), presets.paper())
    assert str(shape) in str(error.value)
    assert_one_sentence(str(error.value))


@pytest.mark.parametrize(
    "dtype", [torch.float16, torch.bfloat16, torch.int8, torch.int16, torch.int64, torch.bool, torch.complex64]
)
def test_hog_refuses_other_dtypes(dtype: torch.dtype) -> None:
    with pytest.raises(TypeError, match=r"^images must be float32 or float64 in 0…1, or uint8 in 0…255, got ") as error:
        hog(torch.zeros(1, 1, 8, 8, dtype=dtype), presets.paper())
    assert str(dtype) in str(error.value)
    assert_one_sentence(str(error.value))


@pytest.mark.parametrize("shape", [(7, 8), (8, 7), (0, 8), (8, 0), (1, 1)])
def test_hog_refuses_images_smaller_than_a_cell(shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=r"^the image must hold at least one cell of 8x8 pixels") as error:
        hog(torch.zeros(1, 1, *shape), presets.paper())
    assert "{}x{}".format(*shape) in str(error.value)
    assert_one_sentence(str(error.value))
