"""The same answer in every mode: batches, precisions, devices, function transforms, compilers, operators, modules."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch._subclasses import FakeTensor, FakeTensorMode
from torch.overrides import TorchFunctionMode
from torch.testing import assert_close
from torch.utils._pytree import tree_leaves

from nablahog.hog import HOG, hog, operators, presets
from nablahog.hog.descriptor import Backend, histograms
from nablahog.hog.kernels.loops import find_loops
from nablahog.hog.steps import histograms_reference, normalize_reference

from .zoo import PRESETS, SPECS, fits, integers, noise, waves

seeds = st.integers(0, 2**31 - 1)
small = st.integers(1, 4)
a_few_times = settings(max_examples=3)  # for each dialect

# one for each way through the code; a compiler takes a second for each
COMPILED: list[tuple[str, Backend]] = [
    *((name, "auto") for name in ("paper", "uoctti", "uoctti-hard", "vlfeat-bilinear", "dlib", "cnn_hog", "skimage")),
    *((name, "auto") for name in ("opencv", "maskfeat", "derivative", "derivative-upper")),
    *((name, "torch") for name in ("derivative", "derivative-upper")),
]


# --- batch, precision, device, dtype ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPECS)
@given(seed=seeds, channels=small)
@a_few_times
def test_single_precision_equals_double(name: str, seed: int, channels: int) -> None:
    """Of continuous images: where hard votes tie, the rounding of one gray value may decide the bin."""
    channels = channels if fits(SPECS[name], channels, 12, 9) else 3
    image = noise(1, channels, 12, 9, seed=seed, dtype=torch.float32)
    single = hog(image, SPECS[name])
    assert single.dtype == torch.float32
    double = hog(image.double(), SPECS[name])
    # a float32's arccosine near 1 loses half of its digits
    tolerance = 1e-3 if SPECS[name].angle == "vlfeat" else 1e-5
    assert_close(single.double(), double, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32])
@pytest.mark.parametrize("name", ["paper", "uoctti", "opencv"])
def test_halves_are_computed_in_single_precision(name: str, dtype: torch.dtype) -> None:
    s = PRESETS[name](4)
    image = noise(2, 3, *s.image_size(2, 2), dtype=torch.float32).to(dtype)
    single = image.float().requires_grad_()
    half = image.clone().requires_grad_()
    expected, descriptor = hog(single, s), hog(half, s)
    assert descriptor.dtype == dtype
    assert_close(descriptor, expected.to(dtype), rtol=0, atol=0)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        under_autocast = hog(half, s)
    assert under_autocast.dtype == torch.float32
    assert_close(under_autocast, expected, rtol=0, atol=0)
    cotangent = torch.ones_like(expected)
    (gradient,) = torch.autograd.grad(under_autocast, half, cotangent)
    assert gradient.dtype == dtype
    assert_close(gradient, torch.autograd.grad(expected, single, cotangent)[0].to(dtype), rtol=0, atol=0)


@pytest.mark.parametrize("layout", ["cells", "native"])
@pytest.mark.parametrize("name", PRESETS)
def test_meta_tensors_have_the_shape(name: str, layout: Any) -> None:
    s = PRESETS[name](4)
    image = noise(2, 3, *s.image_size(2, 3), dtype=torch.float32)
    expected, of_bytes = hog(image, s, layout=layout), hog(image.byte().to("meta"), s)
    on_meta = image.to("meta").requires_grad_()
    descriptor = hog(on_meta, s, layout=layout)
    assert descriptor.is_meta
    assert of_bytes.is_meta
    assert (descriptor.shape, descriptor.dtype) == (expected.shape, expected.dtype)
    descriptor.sum().backward()
    assert on_meta.grad is not None
    assert on_meta.grad.shape == image.shape


class NothingCopied(TorchFunctionMode):
    """Fails where numbers of Python become a tensor: a GPU waits for the copy, and no CUDA graph takes it."""

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        assert func not in (torch.tensor, torch.as_tensor, torch.from_numpy, Tensor.new_tensor)
        if func in (Tensor.__getitem__, Tensor.__setitem__):
            assert not any(isinstance(each, list) for each in tree_leaves(args[1], is_leaf=lambda x: type(x) is list))
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("name", SPECS)
def test_steps_copy_nothing_to_a_device(name: str) -> None:
    s = SPECS[name]
    image = noise(1, s.colours if s.colours > 1 else 1, *s.image_size(3, 3)).requires_grad_()
    with NothingCopied():
        normalize_reference(histograms_reference(image, s), s).sum().backward()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
@pytest.mark.parametrize("name", SPECS)
def test_cuda_equals_cpu(name: str) -> None:
    """Gradients where there are no kinks: of few gray levels it is rounding on which side of a clip an entry is."""
    exact = 1e-12 if SPECS[name].angle == "exact" else 1e-6  # the other angles are of float32 in any case
    for kinks, image in ((False, noise(2, 3, 12, 9)), (True, integers(2, 3, 12, 9, levels=4))):
        for dtype, tolerance in ((torch.float64, exact), (torch.float32, 1e-5)):
            cpu = image.to(dtype).requires_grad_()
            gpu = image.to("cuda", dtype).requires_grad_()
            on_cpu, on_gpu = hog(cpu, SPECS[name]), hog(gpu, SPECS[name])
            assert_close(on_gpu.cpu(), on_cpu, rtol=0, atol=tolerance)
            # the length of what is normalised hardly changes: its gradient would be rounding
            (of_cpu,) = torch.autograd.grad(on_cpu, cpu, waves(on_cpu))
            (of_gpu,) = torch.autograd.grad(on_gpu, gpu, waves(on_gpu))
            if not kinks:
                assert_close(of_gpu.cpu(), of_cpu, rtol=0, atol=10 * tolerance * of_cpu.abs().max().item())


# --- function transforms ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SPECS)
def test_vmap_equals_loop(name: str) -> None:
    """Of batches, of images, and of gradients."""
    s = SPECS[name]

    def energy(image: Tensor) -> Tensor:
        return hog(image.unsqueeze(0), s)[..., ::2].square().sum()

    for images in (noise(3, 2, 3, 8, 8), integers(3, 2, 3, 8, 8, levels=4)):
        looped = torch.stack([hog(batch, s) for batch in images])
        assert_close(torch.func.vmap(lambda batch: hog(batch, s))(images), looped, rtol=0, atol=1e-13)
        single = torch.func.vmap(lambda image: hog(image.unsqueeze(0), s)[0])(images[0])
        assert_close(single, looped[0], rtol=0, atol=1e-13)
        grads = torch.stack([torch.func.grad(energy)(image) for image in images[0]])
        tolerance = 1e-12 * float(grads.abs().max())
        assert_close(torch.func.vmap(torch.func.grad(energy))(images[0]), grads, rtol=0, atol=tolerance)


def test_blocks_are_batched() -> None:
    """Not one image after the other, of which PyTorch warns, if only once."""
    grad = torch.func.grad(lambda image: hog(image.unsqueeze(0), presets.opencv()).sum())
    before = torch.is_warn_always_enabled()
    torch.set_warn_always(True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            torch.func.vmap(grad)(noise(2, 3, 16, 16))
    finally:
        torch.set_warn_always(before)


# --- torch.compile ---------------------------------------------------------------------------------------------------


@pytest.fixture
def fresh_compiler() -> Iterator[None]:
    torch._dynamo.reset()
    yield
    torch._dynamo.reset()


@pytest.mark.slow
@pytest.mark.usefixtures("fresh_compiler")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of PyTorch's own modules, when inductor is loaded
@pytest.mark.parametrize("backend", ["aot_eager", pytest.param("inductor", marks=pytest.mark.xslow)])
@pytest.mark.parametrize(("name", "steps"), COMPILED)
def test_compiled_equals_eager(name: str, steps: Backend, backend: str) -> None:
    """In one graph."""
    s = SPECS[name]
    in_one_graph = torch.compile(lambda z: hog(z, s, backend=steps), backend=backend, fullgraph=True)
    size = s.image_size(2, 2)
    for image in (noise(2, 3, *size, dtype=torch.float32), integers(2, 3, *size, levels=8, dtype=torch.float32)):
        a, b = image.clone().requires_grad_(), image.clone().requires_grad_()
        first, second = in_one_graph(a), hog(b, s, backend=steps)
        assert_close(first, second, rtol=0, atol=1e-6)
        first.square().sum().backward()
        second.square().sum().backward()
        assert_close(a.grad, b.grad, rtol=1e-4, atol=1e-5)


def test_fake_tensors_have_the_shape_of_the_histograms() -> None:
    s, fake = SPECS["dpm"], FakeTensorMode()
    smallest = noise(2, 1, *s.image_size(1, 1))
    cells = histograms(fake.from_tensor(smallest), s)
    assert (type(cells), cells.shape) == (FakeTensor, histograms(smallest, s).shape)
    with pytest.raises(ValueError, match="has 3x1 cells, too few for a dpm"):
        histograms(fake.from_tensor(smallest[..., : s.cell_size[1]]), s)


@pytest.mark.usefixtures("fresh_compiler")
def test_compiled_histograms_equal_eager_ones() -> None:
    s, image = SPECS["uoctti"], noise(1, 3, 24, 16, dtype=torch.float32)
    in_one_graph = torch.compile(lambda z: histograms(z, s), backend="aot_eager", fullgraph=True)
    assert_close(in_one_graph(image), histograms(image, s), rtol=0, atol=1e-6)


def test_exported_and_traced_graphs_take_other_batches() -> None:
    image, other = noise(2, 3, 16, 16, dtype=torch.float32), noise(3, 3, 16, 16, dtype=torch.float32)
    module = HOG("uoctti")
    exported = torch.export.export(module, (image,), dynamic_shapes=({0: torch.export.Dim("B")},)).module()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PyTorch's own: traces are deprecated, and shapes are no tensors
        traced = torch.jit.trace(module, image)  # type: ignore[no-untyped-call]
    for graph in (exported, traced):
        assert torch.equal(graph(other), module(other))


# --- the module ------------------------------------------------------------------------------------------------------


def test_module_is_the_function() -> None:
    image = noise(1, 3, 24, 24, dtype=torch.float32)
    module = HOG("vlfeat", layout="native")
    assert torch.equal(module(image), hog(image, presets.vlfeat(), layout="native"))
    assert not module.state_dict()
    assert "layout='native'" in repr(module)


CELLS_VJP, DESCRIBE_VJP = torch.ops.nablahog.cells_vjp.default, torch.ops.nablahog.describe_vjp.default


def _with_gradient(step: Any, x: Tensor) -> tuple[Tensor, Tensor]:
    x = x.detach().requires_grad_()
    output = step(x)
    return output.detach(), torch.autograd.grad(output, x, waves(output))[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "uoctti", "opencv"])
@pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor that is not a leaf")  # read by PyTorch 2.14's check
def test_operators_pass_opcheck(name: str) -> None:
    text = SPECS[name].to_json()
    for images in (noise(2, 3, 14, 13).requires_grad_(), noise(1, 1, 14, 13, dtype=torch.float32)):
        torch.library.opcheck(operators.cells, (images, text))
        torch.library.opcheck(operators.describe, (images, text))
        for step, vjp in ((operators.cells, CELLS_VJP), (operators.describe, DESCRIBE_VJP)):
            torch.library.opcheck(vjp, (images.detach(), torch.ones_like(step(images.detach(), text)), text))


OF_ONE_COLOUR = [name for name, s in SPECS.items() if find_loops(s).norm is not None and s.colours == 1]


@pytest.mark.parametrize("name", OF_ONE_COLOUR)
def test_operators_are_the_functions(name: str) -> None:
    s, text = SPECS[name], SPECS[name].to_json()
    for x in (noise(2, 3, 14, 13), noise(1, 1, 14, 13)):
        for one, other in zip(
            _with_gradient(lambda images: hog(images, s), x),
            _with_gradient(lambda images: operators.describe(images, text), x),
            strict=True,
        ):
            assert_close(one, other, rtol=0, atol=1e-12)
        of_cells = operators.cells(x, text).permute(0, 3, 1, 2)
        assert torch.equal(of_cells, histograms(x, s))


@pytest.mark.parametrize("operator", [operators.cells, operators.describe])
def test_operators_take_one_colour(operator: Any) -> None:
    with pytest.raises(ValueError, match=r"of one colour, got .* with colour 'separate'"):
        operator(noise(1, 3, 14, 13), SPECS["cells-separate"].to_json())
