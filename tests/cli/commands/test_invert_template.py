"""``nablahog invert-template``."""

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

FEW = ["--max-evaluations", "20"]


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


def test_opencvs_people_detector_is_known(tmp_path: Path, people: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["invert-template", people, "-o", str(tmp_path / "out"), *FEW]) == 0
    assert names(tmp_path / "out") == [
        "index.html",
        "people_negative.png",
        "people_positive.png",
        "people_templates.png",
    ]
    with Image.open(tmp_path / "out" / "people_positive.png") as picture:
        assert picture.size == (64, 128)
        result = np.asarray(picture.convert("L"), float)
    assert abs(np.corrcoef(result.ravel(), disc().flatten())[0, 1]) > 0.4
    assert "15x7x36" in capsys.readouterr().out


def test_options_say_what_an_array_is(tmp_path: Path, people: str) -> None:
    weights = np.load(people)[:-1]
    np.savez(tmp_path / "named.npz", svm=weights, other=np.ones(3))
    command = ["invert-template", str(tmp_path / "named.npz"), "--key", "svm", "--preset", "opencv", *FEW]
    assert main([*command, "-o", str(tmp_path / "a")]) == 0
    assert main(["invert-template", people, *FEW, "-o", str(tmp_path / "b")]) == 0
    a, b = (Image.open(tmp_path / name) for name in ("a/named_positive.png", "b/people_positive.png"))
    np.testing.assert_array_equal(np.asarray(a), np.asarray(b))


def test_templates_with_rows_and_columns(tmp_path: Path) -> None:
    np.save(tmp_path / "fhog.npy", np.random.default_rng(0).standard_normal((31, 5, 6)))
    command = ["invert-template", str(tmp_path / "fhog.npy"), "--preset", "dlib", "-o", str(tmp_path / "out"), *FEW]
    assert main(command) == 0
    with Image.open(tmp_path / "out" / "fhog_positive.png") as picture:
        assert picture.size == (64, 56)


def test_a_model_of_voc_release5(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path / "toy.mat")
    assert main(["invert-template", str(path), "-o", str(tmp_path / "out"), *FEW]) == 0
    numbered = [f"toy_{k}_{sign}.png" for k in (1, 2) for sign in ("negative", "positive")]
    assert names(tmp_path / "out") == ["index.html", *numbered, "toy_templates.png"]
    out = capsys.readouterr().out
    assert "component 1, root" in out
    assert "component 1, parts" in out
    assert f"Look at {tmp_path / 'out' / 'index.html'}, which also says what the figures mean" in out
    page = (tmp_path / "out" / "index.html").read_text()
    for text in ("<h2>toy.mat, component 1, root, dpm</h2>", '<th scope="row">toy.mat, component 1, parts</th>'):
        assert text in page
    assert page.count("data:image/png;base64,") == 2 * 4
    for sign in ("for", "against"):
        assert f'alt="An image with the edges that speak {sign} a detection by toy.mat, component 1, root"' in page


def test_a_file_that_is_skipped_is_on_the_page(tmp_path: Path, people: str) -> None:
    np.save(tmp_path / "odd.npy", np.ones(17))
    assert main(["invert-template", people, str(tmp_path / "odd.npy"), "-o", str(tmp_path / "out"), *FEW]) == 3
    page = (tmp_path / "out" / "index.html").read_text()
    assert "<h2>people.npy, opencv</h2>" in page
    assert page.index("Skipped inputs") < page.index("odd.npy") < page.index("expected --preset NAME")


def test_refusals(tmp_path: Path, people: str, refused: Callable[..., None]) -> None:
    output = ["-o", str(tmp_path / "out")]
    text = tmp_path / "weights.txt"
    text.write_text("1 2 3")
    refused(
        "invert-template", str(text), *output, message=f"{text}: expected a model of voc-release5 (.mat) or an array"
    )
    refused("invert-template", str(tmp_path / "none.npy"), *output, message="none.npy: no such file")
    np.save(tmp_path / "odd.npy", np.ones(17))
    refused("invert-template", str(tmp_path / "odd.npy"), *output, message="expected --preset NAME")
    refused(
        *("invert-template", str(tmp_path / "odd.npy"), "--preset", "opencv", *output),
        message="odd.npy: the opencv descriptor",
    )
    np.save(tmp_path / "nothing.npy", -np.ones(3780))
    refused("invert-template", str(tmp_path / "nothing.npy"), *output, message="has no positive weights of edges")
    assert not (tmp_path / "out").exists()
