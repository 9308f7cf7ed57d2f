"""``nablahog invert --template``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from nablahog import hog, presets
from nablahog.cli.main import main
from tests.io.dpm_models import written

from ..common import names


def disc() -> torch.Tensor:
    y, x = torch.meshgrid(torch.linspace(-2, 2, 128), torch.linspace(-1, 1, 64), indexing="ij")
    return torch.sigmoid(15 * (0.6 - torch.hypot(x, y / 2)))[None, None]


@pytest.fixture
def people(tmp_path: Path) -> str:
    """Weights as OpenCV's people detector has them, with a bias."""
    spec = presets.opencv()
    noise = torch.rand(1, 1, 128, 64, generator=torch.Generator().manual_seed(0))
    weights = hog(disc(), spec, layout="native") - hog(noise, spec, layout="native")
    np.save(tmp_path / "people.npy", np.append(weights[0].numpy(), -6.0))
    return str(tmp_path / "people.npy")


def test_opencvs_people_detector_is_recognised(tmp_path: Path, people: str, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "odd.npy", np.ones(17))
    assert main(["invert", people, str(tmp_path / "odd.npy"), "--template", "-o", str(tmp_path / "out")]) == 3
    kinds = ("glyphs", "preimage", "thumbnails")
    pictures = [f"people_{sign}_{kind}.png" for sign in ("negative", "positive") for kind in kinds]
    assert names(tmp_path / "out") == ["index.html", *pictures, "results.json"]
    with Image.open(tmp_path / "out" / "people_positive_preimage.png") as picture:
        assert picture.size == (64, 128)
        result = np.asarray(picture.convert("L"), float)
    assert abs(np.corrcoef(result.ravel(), disc().flatten())[0, 1]) > 0.4
    assert "positive weights" in capsys.readouterr().out
    page = (tmp_path / "out" / "index.html").read_text()
    assert "<h2>people.npy, positive weights, opencv</h2>" in page
    assert "or its negative, 50%" in page
    assert page.index("Skipped inputs") < page.index("odd.npy") < page.index("expected --preset NAME")


def test_an_array_of_a_preset(tmp_path: Path) -> None:
    weights = np.random.default_rng(0).standard_normal((31, 5, 6))
    np.savez(tmp_path / "fhog.npz", svm=weights, other=np.ones(3))
    options = ["--template", "--key", "svm", "--preset", "dlib", "-o", str(tmp_path / "out")]
    assert main(["invert", str(tmp_path / "fhog.npz"), *options]) == 0
    with Image.open(tmp_path / "out" / "fhog_positive_preimage.png") as picture:
        assert picture.size == (64, 56)


def test_a_model_of_voc_release5(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path / "toy.mat")
    assert main(["invert", str(path), "--template", "-o", str(tmp_path / "out")]) == 0
    assert {f"toy_{k}_{sign}_preimage.png" for k in (1, 2) for sign in ("negative", "positive")} < {
        *names(tmp_path / "out")
    }
    out = capsys.readouterr().out
    assert "component 1, root" in out
    assert "component 1, parts" in out
    page = (tmp_path / "out" / "index.html").read_text()
    assert page.count("data:image/png;base64,") == 2 * 4


def test_refusals(tmp_path: Path, people: str, refused: Callable[..., None]) -> None:
    command = ["--template", "-o", str(tmp_path / "out")]
    text, odd, nothing = (tmp_path / name for name in ("weights.txt", "odd.npy", "nothing.npy"))
    text.write_text("1 2 3")
    np.save(odd, np.ones(17))
    np.save(nothing, -np.ones(3780))
    refused("invert", str(text), *command, message=f"{text}: expected a model of voc-release5 (.mat) or an array")
    refused("invert", str(odd), *command, "--preset", "opencv", message="odd.npy: the opencv descriptor")
    refused("invert", str(nothing), *command, message="has no positive weights of edges")
    refused("invert", people, *command, "--quality", "fast", message="--template and --quality fast exclude each other")
