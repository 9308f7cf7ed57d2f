"""What must hold for any image: symmetries, invariances, and the same answer in every mode, precision and device."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor, nn
from torch.testing import assert_close

from nablahog.hog import HOG, FourBlockNorm, GlobalNorm, HOGSpec, hog, presets

from .zoo import DOUBLE, PRESETS, SPECS, integers, noise, spec

seeds = st.integers(0, 2**31 - 1)
small = st.integers(1, 4)
names = st.sampled_from(sorted(PRESETS))
any_spec = st.sampled_from(sorted(SPECS))


# --- symmetries ------------------------------------------------------------------------------------------------------


def mirrored(orientations: int, period: int, quarter_turns: int, bin_offset: float) -> list[int]:
    """Bin of a mirrored gradient for each bin: Θ becomes 180°·``quarter_turns``/2 - Θ, in bins of ``period`` a turn."""
    shift = quarter_turns * period / 4 - 2 * bin_offset
    assert shift == int(shift)
    return [(int(shift) - k) % orientations for k in range(orientations)]


def flip_permutation(s: HOGSpec, axis: str) -> list[int]:
    """Channel of the original cell that each channel of the mirrored one equals; ``axis`` is "x" or "y"."""
    turns = 2 if axis == "x" else 0  # left-right: 180° - Θ; up-down: -Θ
    directed = mirrored(s.bins, s.bins if s.signed else 2 * s.bins, turns, s.bin_offset)
    if isinstance(s.normalizer, GlobalNorm):
        return directed
    n = s.bins // 2
    undirected = mirrored(n, 2 * n, turns, s.bin_offset)
    texture = [1, 0, 3, 2] if axis == "x" else [2, 3, 0, 1]  # blocks up-left, up-right, down-left, down-right
    of_parts = {"directed": directed, "undirected": undirected, "texture": texture}
    channels: list[int] = []
    for part in s.normalizer.parts:
        channels += [len(channels) + k for k in of_parts[part]]
    return channels


def test_flip_permutation_of_the_presets() -> None:
    """As VLFeat states it, directed o to (n - o) mod 2n and undirected o to (n - o) mod n; the paper's k to 8 - k."""
    assert flip_permutation(presets.uoctti(), "x") == [
        *(9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 17, 16, 15, 14, 13, 12, 11, 10),
        *(18, 26, 25, 24, 23, 22, 21, 20, 19),
        *(28, 27, 30, 29),
    ]
    assert flip_permutation(presets.aubry(), "x") == [0, 8, 7, 6, 5, 4, 3, 2, 1]
    assert flip_permutation(presets.paper(), "x") == [8, 7, 6, 5, 4, 3, 2, 1, 0]
    assert flip_permutation(presets.paper(bin_offset=0), "x") == [0, 8, 7, 6, 5, 4, 3, 2, 1]


@given(seed=seeds, rows=small, cols=small, channels=st.integers(1, 3), axis=st.sampled_from("xy"), data=st.data())
def test_mirrored_image_has_permuted_descriptor(
    seed: int, rows: int, cols: int, channels: int, axis: str, data: st.DataObject
) -> None:
    s = data.draw(
        st.sampled_from(
            [
                *(make((3, 4)) for make in PRESETS.values()),
                presets.paper((3, 4), bin_offset=0, border="zero", bins=8),
                presets.uoctti((3, 4), orientations=4),
                spec(cell_size=(3, 4), signed=True, bins=6, bin_offset=0.5, border="replicate", vote="hard"),
            ]
        )
    )
    image = noise(1, channels, 3 * rows, 4 * cols, seed=seed)
    dim = -1 if axis == "x" else -2
    expected = hog(image, s).flip(dim - 1)[..., flip_permutation(s, axis)]
    assert_close(hog(image.flip(dim), s), expected, rtol=0, atol=1e-12)


@given(seed=seeds, axis=st.sampled_from("xy"), name=st.sampled_from(["paper", "paper-robust", "uoctti"]))
def test_mirrored_bytes_have_mirrored_derivatives(seed: int, axis: str, name: str) -> None:
    """Full of gradients on bin centres, where a one-sided derivative would prefer a sense of rotation."""
    s = PRESETS[name](4)
    image = integers(1, 1, 8, 12, seed=seed, levels=6)
    dim = -1 if axis == "x" else -2
    weights = noise(1, 2, 3, s.channels, seed=seed)
    mirrored_weights = weights.flip(dim - 1)[..., flip_permutation(s, axis)]
    grad = torch.func.grad(lambda z: (weights * hog(z, s)).sum())(image)
    of_mirrored = torch.func.grad(lambda z: (mirrored_weights * hog(z, s)).sum())(image.flip(dim))
    assert_close(of_mirrored, grad.flip(dim), rtol=1e-9, atol=1e-9)


@given(seed=seeds, down=st.integers(0, 1), right=st.integers(0, 1), name=names)
def test_shift_by_a_cell_moves_the_cells(seed: int, down: int, right: int, name: str) -> None:
    s = PRESETS[name]((3, 4))
    scene = noise(1, 1, 3 * 8, 4 * 8, seed=seed)
    here = hog(scene[..., : 3 * 7, : 4 * 7], s)
    there = hog(scene[..., 3 * down : 3 * (7 + down), 4 * right : 4 * (7 + right)], s)
    # of 7 cells, 2 to 4 are clean: the image border reaches one cell far into the votes, one more into the blocks
    here, there = here[:, 2 + down : 4 + down, 2 + right : 4 + right], there[:, 2:4, 2:4]
    if isinstance(s.normalizer, GlobalNorm):  # its one factor depends on what came into view
        here, there = here / here.norm(), there / there.norm()
    assert_close(there, here, rtol=0, atol=1e-12)


# --- contrast and brightness -----------------------------------------------------------------------------------------


@given(seed=seeds, contrast=st.floats(0.05, 1.0))
def test_contrast(seed: int, contrast: float) -> None:
    """Robust and UoCTTI norms remove it, up to ε; as printed, Eq. 7 leaves its square root."""
    image = noise(1, 1, 12, 12, seed=seed)
    for name, exponent in {"paper-robust": 0.0, "uoctti": 0.0, "uoctti-hard": 0.0, "paper": 0.5}.items():
        s = PRESETS[name](4)
        assert_close(hog(contrast * image, s), contrast**exponent * hog(image, s), rtol=1e-4, atol=1e-7)


@given(seed=seeds)
def test_epsilon_bounds_flat_images(seed: int) -> None:
    """Far below ε the descriptor vanishes with the contrast instead of being blown up to unit length."""
    image = 0.5 + 1e-9 * noise(1, 1, 8, 8, seed=seed)
    for make in PRESETS.values():
        assert hog(image, make(4)).abs().max() < 1e-3


@given(seed=seeds, brightness=st.floats(-1.0, 1.0), name=any_spec)
def test_brightness_changes_nothing(seed: int, brightness: float, name: str) -> None:
    s = SPECS[name]
    if s.border == "zero":
        s = dataclasses.replace(s, border="replicate")  # black beyond the border is a reference of brightness
    image = noise(1, 3, 9, 8, seed=seed)
    assert_close(hog(image + brightness, s), hog(image, s), rtol=0, atol=1e-11)


@given(seed=seeds)
def test_opposite_contrast_is_the_same_to_unsigned_bins(seed: int) -> None:
    image = noise(1, 1, 8, 12, seed=seed)
    assert_close(hog(1 - image, presets.paper(4)), hog(image, presets.paper(4)), rtol=0, atol=1e-12)
    positive, negative = hog(image, presets.uoctti(4)), hog(1 - image, presets.uoctti(4))
    assert_close(negative[..., :18].roll(9, dims=-1), positive[..., :18], rtol=0, atol=1e-12)
    assert_close(negative[..., 18:], positive[..., 18:], rtol=0, atol=1e-12)


# --- ranges ----------------------------------------------------------------------------------------------------------


@given(seed=seeds, name=any_spec, channels=small)
def test_range_and_shape(seed: int, name: str, channels: int) -> None:
    s = SPECS[name]
    descriptor = hog(noise(2, channels, 11, 13, seed=seed), s)
    assert descriptor.shape == (2, *s.grid(11, 13), s.channels)
    assert descriptor.is_contiguous()
    assert (descriptor >= 0).all()
    if isinstance(s.normalizer, FourBlockNorm):
        orientations = s.channels - s.normalizer.channels_of("texture", s.bins)
        assert (descriptor[..., :orientations] <= 2 * s.normalizer.clip + 1e-15).all()
    elif s.normalizer.form == "robust":
        assert (descriptor.flatten(1).norm(dim=1) <= 1).all()


@given(seed=seeds, name=any_spec)
def test_any_layout_in_memory(seed: int, name: str) -> None:
    image = noise(2, 3, 9, 8, seed=seed)
    expected = hog(image, SPECS[name])
    for view in (
        image.contiguous(memory_format=torch.channels_last),
        image.repeat_interleave(2, dim=-1)[..., ::2],
        image.transpose(-1, -2).contiguous().transpose(-1, -2),
    ):
        assert_close(hog(view, SPECS[name]), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", SPECS)
def test_input_is_not_changed(name: str) -> None:
    image = noise(1, 3, 8, 8)
    before = image.clone()
    hog(image, SPECS[name])
    assert (image == before).all()


def test_empty_batch() -> None:
    assert hog(torch.zeros(0, 3, 16, 16), presets.uoctti()).shape == (0, 2, 2, 31)


# --- batch, precision, device, dtype ---------------------------------------------------------------------------------


@given(seed=seeds, name=any_spec, batch=st.integers(1, 5))
def test_batch_equals_loop(seed: int, name: str, batch: int) -> None:
    images = noise(batch, 3, 9, 10, seed=seed)
    looped = torch.cat([hog(image.unsqueeze(0), SPECS[name]) for image in images])
    assert_close(hog(images, SPECS[name]), looped, rtol=0, atol=1e-13)


@given(seed=seeds, name=any_spec, channels=small)
def test_single_precision_equals_double(seed: int, name: str, channels: int) -> None:
    image = noise(1, channels, 12, 9, seed=seed, dtype=torch.float32)
    single = hog(image, SPECS[name])
    assert single.dtype == torch.float32
    double = hog(image.double(), SPECS[name])
    assert_close(single.double(), double, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_bytes_follow_the_default_dtype(dtype: torch.dtype) -> None:
    image = (255 * integers(1, 3, 8, 8)).round().to(torch.uint8)
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        for s in SPECS.values():
            descriptor = hog(image, s)
            assert descriptor.dtype == dtype
            assert_close(descriptor, hog(image.to(dtype) / 255, s), rtol=0, atol=1e-5)
    finally:
        torch.set_default_dtype(before)


@pytest.mark.parametrize("name", PRESETS)
def test_autocast_keeps_precision(name: str) -> None:
    image = noise(1, 3, 8, 8, dtype=torch.float32)
    expected = hog(image, PRESETS[name](4))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        descriptor = hog(image, PRESETS[name](4))
    assert descriptor.dtype == torch.float32
    assert_close(descriptor, expected)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
@pytest.mark.parametrize("name", SPECS)
def test_cuda_equals_cpu(name: str) -> None:
    for image in (noise(2, 3, 12, 9), integers(2, 3, 12, 9, levels=4)):
        for dtype, tolerance in ((torch.float64, 1e-12), (torch.float32, 1e-5)):
            cpu = image.to(dtype).requires_grad_()
            gpu = image.to("cuda", dtype).requires_grad_()
            on_cpu, on_gpu = hog(cpu, SPECS[name]), hog(gpu, SPECS[name])
            assert_close(on_gpu.cpu(), on_cpu, rtol=0, atol=tolerance)
            on_cpu.square().sum().backward()
            on_gpu.square().sum().backward()
            assert cpu.grad is not None
            assert gpu.grad is not None
            size = cpu.grad.abs().max().item()
            assert_close(gpu.grad.cpu(), cpu.grad, rtol=0, atol=10 * tolerance * size)


# --- function transforms ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPECS)
def test_vmap_equals_loop(name: str) -> None:
    s = SPECS[name]
    for images in (noise(3, 2, 3, 8, 8), integers(3, 2, 3, 8, 8, levels=4)):
        looped = torch.stack([hog(batch, s) for batch in images])
        assert_close(torch.func.vmap(lambda batch: hog(batch, s))(images), looped, rtol=0, atol=1e-13)
        single = torch.func.vmap(lambda image: hog(image.unsqueeze(0), s)[0])(images[0])
        assert_close(single, looped[0], rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", PRESETS)
def test_vmap_of_grad_equals_loop(name: str) -> None:
    def energy(image: Tensor) -> Tensor:
        return hog(image.unsqueeze(0), PRESETS[name](4))[..., ::2].square().sum()

    images = noise(3, 1, 8, 8)
    looped = torch.stack([torch.func.grad(energy)(image) for image in images])
    assert looped.abs().max() > 0
    assert_close(torch.func.vmap(torch.func.grad(energy))(images), looped, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", SPECS)
def test_jvp_is_a_column_of_the_jacobian(name: str) -> None:
    s = SPECS[name]
    image = integers(1, 3, 8, 8, levels=8)
    jacobian = torch.func.jacrev(lambda z: hog(z, s))(image)
    for c, y, x in ((0, 3, 4), (1, 0, 0), (2, 5, 7)):
        tangent = torch.zeros_like(image)
        tangent[0, c, y, x] = 1
        _, column = torch.func.jvp(lambda z: hog(z, s), (image,), (tangent,))
        assert_close(column, jacobian[..., 0, c, y, x], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", PRESETS)
def test_hessian(name: str) -> None:
    """Symmetric, not zero, and the Jacobian of the gradient."""
    weights = noise(1, 2, 2, PRESETS[name](2).channels, seed=1)

    def energy(image: Tensor) -> Tensor:
        return (hog(image, PRESETS[name](2)) * weights).sum()

    image = noise(1, 1, 4, 4)
    hessian = torch.func.hessian(energy)(image).reshape(16, 16)
    assert hessian.abs().max() > 0.1
    assert_close(hessian, hessian.T, rtol=1e-9, atol=1e-9)
    reverse = torch.func.jacrev(torch.func.jacrev(energy))(image).reshape(16, 16)
    assert_close(reverse, hessian, rtol=1e-9, atol=1e-9)


# --- torch.compile ---------------------------------------------------------------------------------------------------


@pytest.fixture
def fresh_compiler() -> Iterator[None]:
    torch._dynamo.reset()
    yield
    torch._dynamo.reset()


def assert_compiled_equals_eager(s: HOGSpec, backend: str) -> None:
    compiled = torch.compile(lambda z: hog(z, s), backend=backend, fullgraph=True)
    for image in (noise(2, 3, 8, 8, dtype=torch.float32), integers(2, 3, 8, 8, levels=8, dtype=torch.float32)):
        a, b = image.clone().requires_grad_(), image.clone().requires_grad_()
        first, second = compiled(a), hog(b, s)
        assert_close(first, second, rtol=0, atol=1e-6)
        first.square().sum().backward()
        second.square().sum().backward()
        assert_close(a.grad, b.grad, rtol=1e-4, atol=1e-5)


@pytest.mark.usefixtures("fresh_compiler")
@pytest.mark.parametrize("name", PRESETS)
def test_compiles_to_one_graph(name: str) -> None:
    assert_compiled_equals_eager(PRESETS[name](4), "aot_eager")


@pytest.mark.usefixtures("fresh_compiler")
@pytest.mark.parametrize("name", PRESETS)
def test_has_no_graph_break(name: str) -> None:
    explanation = torch._dynamo.explain(hog)(noise(1, 3, 8, 8), PRESETS[name](4))
    assert explanation.graph_break_count == 0
    assert explanation.graph_count == 1


@pytest.mark.slow
@pytest.mark.usefixtures("fresh_compiler")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of PyTorch's own modules, when inductor is loaded
@pytest.mark.parametrize("name", PRESETS)
def test_inductor_equals_eager(name: str) -> None:
    assert_compiled_equals_eager(PRESETS[name](4), "inductor")


# --- the module ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PRESETS)
def test_module_is_the_function(name: str) -> None:
    s = PRESETS[name](4)
    module = HOG(s)
    image = noise(1, 3, 8, 8)
    assert (module(image) == hog(image, s)).all()
    assert not module.state_dict()
    assert not list(module.parameters())
    assert s.name in repr(module)
    assert "(4, 4)" in repr(module)


def test_module_in_a_network() -> None:
    network = nn.Sequential(HOG(presets.uoctti(4)), nn.Flatten(), nn.Linear(2 * 2 * 31, 1)).to(DOUBLE)
    image = noise(2, 3, 8, 8).requires_grad_()
    network(image).sum().backward()
    assert image.grad is not None
    assert image.grad.abs().max() > 0
    assert set(network.state_dict()) == {"2.weight", "2.bias"}
