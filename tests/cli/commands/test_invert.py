"""``nablahog invert``, of descriptors and of the weights of detectors, and ``nablahog demo``."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

import nablahog
from nablahog import hog, presets
from nablahog.cli import terminal
from nablahog.cli.commands import demo, invert
from nablahog.cli.main import main
from nablahog.cli.results import inversion_page
from nablahog.cli.results.inversion import Inversion, say_unsure
from nablahog.compat.opencv import HOGDescriptor
from nablahog.invert import template
from nablahog.io.images import read_image
from nablahog.requests.sources import Source
from tests.io.dpm_models import written

from ..common import FAST, SMALL, names


def test_invert(tmp_path: Path, photo: str, descriptor: str, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["invert", photo, descriptor, photo, "-o", str(tmp_path / "out"), *SMALL]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert str(tmp_path / "out" / "index.html") in printed.out
    page = (tmp_path / "out" / "index.html").read_text()
    assert "Pearson correlation" in page
    assert page.count("data:image/png;base64,") == 2 + 4 + 2 + 4  # the slider, and all of each input
    pictures = [f"{s}_{w}.png" for s in ("cat", "cat_2", "stored") for w in ("glyphs", "preimage", "thumbnails")]
    assert names(tmp_path / "out") == sorted([*pictures, "index.html", "results.json"])
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert [result["input"] for result in results] == [photo, descriptor, photo]
    for result in results:
        assert result["descriptor"] == "uoctti"
        assert 0 < result["distance"] < 1
        assert read_image(tmp_path / "out" / result["preimage"]).shape[1:] == tuple(result["image_size"])
    known, unknown, _ = results
    assert all(isinstance(known[name], float) for name in ("cc", "mi", "ssim", "psnr"))
    assert unknown["cc"] is unknown["mi"] is unknown["ssim"] is unknown["psnr"] is None


@pytest.mark.parametrize(("polarity", "odds"), [(0.79, "21%"), (0.8, None), (0.81, None)])
def test_the_negative_is_shown_and_regions_are_gray_below_a_confidence_of_0_8(
    polarity: float, odds: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    spec, image = presets.paper(8), torch.tensor([[0.0, 0.2, 0.6, 0.8]])
    source = Source("cat.npz", "cat", torch.zeros(1, 1, 9), spec, (1, 4), None)
    regions = torch.tensor([[0.2, 0.5, 0.65, 0.8]])  # that they are rightly bright or dark
    found = Inversion(source, image, {}, 1.0, "", polarity=polarity, regions=regions)
    shown = {panel.caption: panel.picture for panel in found.panels()}
    assert [caption for caption in shown if "negative" in caption] == ([f"or its negative, {odds}"] if odds else [])
    np.testing.assert_allclose(shown["gray where unsure"], [[0.4, 0.4, 0.5, 0.8]], atol=1e-6)
    assert all(np.array_equal(shown[caption], 1 - image) for caption in shown if "negative" in caption)
    for many in (5, 6):
        say_unsure([found] * many)
        said = capsys.readouterr().out
        assert said.count("cat.npz (21%)") == (5 if odds else 0)
        assert ("…" in said) == (bool(odds) and many == 6)


@pytest.mark.parametrize("most", [2, 3])
def test_of_many_inputs_the_first_are_shown(
    tmp_path: Path, images: str, most: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(invert, "LINES", most)
    monkeypatch.setattr(inversion_page, "SHOWN_INPUTS", most)
    out = tmp_path / "out"
    assert main(["invert", images, "-o", str(out), *FAST, "--size", "24"]) == 0
    printed, page = capsys.readouterr().out, (out / "index.html").read_text()
    assert re.findall("and (.+) more in", printed) == (["1"] if most == 2 else [])
    assert ("The pictures of 2 of 3 are below." in page) == (most == 2)
    assert [result["input"] for result in json.loads((out / "results.json").read_text())] == [
        f"{images}/{k}.png" for k in range(3)
    ]


def test_progress(
    tmp_path: Path, photo: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal, "FIRST_LINE", 0.0)
    assert main(["invert", photo, "-o", str(tmp_path / "out"), *SMALL]) == 0
    assert re.match(r"nablahog invert: \d+ of \d+ evaluations done .*\(batch 1 of 1, 1 x ", capsys.readouterr().err)


def test_it_is_the_preimage_of_the_library(tmp_path: Path, photo: str) -> None:
    spec, descriptor = presets.uoctti(8), nablahog.hog(read_image(photo)[None], presets.uoctti(8))
    expected = nablahog.reconstruct(descriptor, spec, (60, 80), prior="default", quality="best")
    assert main(["invert", photo, "--quality", "best", "-o", str(tmp_path / "out")]) == 0
    figures = json.loads((tmp_path / "out" / "results.json").read_text())
    assert figures[0]["distance"] == pytest.approx(float(expected.distance))


@pytest.mark.slow
@pytest.mark.usefixtures("two_iterations")
def test_the_papers_search(tmp_path: Path, photo: str, descriptor: str) -> None:
    out = tmp_path / "out"
    assert main(["invert", photo, descriptor, "-o", str(out), "--method", "paper", "--size", "32"]) == 0
    assert {"cat_iterations.png", "stored_iterations.png", "cat_preimage.png"} <= {*names(out)}
    with Image.open(out / "cat_iterations.png") as sheet, Image.open(out / "stored_iterations.png") as unknown:
        assert sheet.width > unknown.width  # the photograph is shown where it is known


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


@pytest.mark.slow
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
    assert "uncertain" not in capsys.readouterr().out  # no prior was asked
    page = (tmp_path / "out" / "index.html").read_text()
    assert "<h2>people.npy, positive weights, opencv</h2>" in page
    assert "or its negative" in page
    columns = re.findall(r"<th scope=\"col\"[^>]*>([^<]*)</th>", page.partition("</table>")[0])
    assert columns == ["input", "descriptor", "size", "distance", "seconds"]
    assert page.index("Skipped inputs") < page.index("odd.npy") < page.index("expected --preset NAME")


@pytest.mark.slow
def test_detectors_without_the_option(
    tmp_path: Path, people: str, refused: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["-o", str(tmp_path / "out")]
    for detector in (people, str(written(tmp_path / "toy.mat"))):
        refused("invert", detector, *out, "--preset", "opencv", message="--template")
    refused("invert", str(tmp_path / "no.mat"), *out, "--template", message="no such file")
    saved = str(tmp_path / "saved.yml.gz")
    HOGDescriptor().save(saved)
    for command in ("invert", "glyph"):
        refused(command, saved, *out, message=f"{saved}: expected a photograph or descriptor; `nablahog invert --temp")
    weights = str(tmp_path / "weights.npy")
    np.save(weights, np.load(people)[:-1])
    assert main(["invert", weights, *out, "--preset", "opencv", "--quality", "fast"]) == 0
    assert "--template" in capsys.readouterr().err


@pytest.mark.slow
def test_an_array_of_a_preset(tmp_path: Path) -> None:
    weights = np.random.default_rng(0).standard_normal((31, 5, 6))
    np.savez(tmp_path / "fhog.npz", svm=weights, other=np.ones(3))
    options = ["--template", "--key", "svm", "--preset", "dlib", "-o", str(tmp_path / "out")]
    assert main(["invert", str(tmp_path / "fhog.npz"), *options]) == 0
    with Image.open(tmp_path / "out" / "fhog_positive_preimage.png") as picture:
        assert picture.size == (64, 56)


@pytest.mark.slow
def test_a_model_of_voc_release5(tmp_path: Path) -> None:
    path = written(tmp_path / "toy.mat")
    assert main(["invert", str(path), "--template", "-o", str(tmp_path / "out")]) == 0
    assert {f"toy_{k}_{sign}_preimage.png" for k in (1, 2) for sign in ("negative", "positive")} < {
        *names(tmp_path / "out")
    }
    page = (tmp_path / "out" / "index.html").read_text()
    assert "component 1, root" in page
    assert "component 1, parts" in page
    assert page.count("data:image/png;base64,") == 2 * 4


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["yml", "xml.gz", "json"])
def test_a_detector_that_opencv_saved(tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(template, "TEMPLATE_SAMPLES", 2)
    hog = HOGDescriptor((32, 32), (16, 16), (8, 8), (8, 8), 9)
    without = str(tmp_path / "without.yml")
    hog.save(without)
    hog.setSVMDetector(np.random.default_rng(0).normal(size=hog.getDescriptorSize() + 1))
    detector = str(tmp_path / f"detector.{ending}")
    hog.save(detector)
    out = tmp_path / "out"
    assert main(["invert", detector, without, "--template", "-o", str(out), "--quiet"]) == 3
    assert {f"{Path(detector).stem}_{sign}_preimage.png" for sign in ("positive", "negative")} <= set(names(out))
    with Image.open(out / f"{Path(detector).stem}_positive_preimage.png") as picture:
        assert picture.size == (32, 32)


def test_refusals(tmp_path: Path, people: str, refused: Callable[..., None]) -> None:
    command = ["--template", "-o", str(tmp_path / "out")]
    text, odd, nothing = (tmp_path / name for name in ("weights.txt", "odd.npy", "nothing.npy"))
    text.write_text("1 2 3")
    np.save(odd, np.ones(17))
    np.save(nothing, -np.ones(3780))
    refused("invert", str(text), *command, message=f"{text}: expected a model of voc-release5 (.mat), a HOG")
    refused("invert", str(odd), *command, "--preset", "opencv", message="odd.npy: the opencv descriptor")
    refused("invert", str(nothing), *command, message="has no positive weights of edges")
    np.save(nothing, np.ones(3780))
    refused("invert", str(nothing), *command, message="has no negative weights of edges")
    assert not any((tmp_path / "out").glob("*"))  # of neither sign
    refused(
        "invert",
        people,
        *command,
        "--quality",
        "fast",
        message="template and quality fast exclude each other",
        status=2,
    )


@pytest.mark.slow
def test_demo(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "DEMO_SIZE", 64)
    monkeypatch.setattr(terminal, "FIRST_LINE", 0.0)
    assert main(["demo", "-o", str(tmp_path / "demo")]) == 0
    printed = capsys.readouterr()
    assert str(tmp_path / "demo" / "index.html") in printed.out
    assert re.match(r"nablahog demo: \d+ of [\d,]+ evaluations done", printed.err)
    parts = ("difference", "glyphs", "preimage", "thumbnails")
    pictures = [f"{name}_{part}.png" for name in ("paper", "uoctti") for part in parts]
    unsure = ["paper_regions.png", "paper_samples.png"]
    assert names(tmp_path / "demo") == sorted([*pictures, *unsure, "photograph.png", "figures.json", "index.html"])
    assert [row["descriptor"] for row in json.loads((tmp_path / "demo" / "figures.json").read_text())] == [
        "uoctti",
        "paper",
    ]
    html = (tmp_path / "demo" / "index.html").read_text()
    negatives = html.count('alt="The negative')  # if the prior is unsure
    assert html.count("data:image/png;base64,") == 2 + 8 + 1 + demo.SAMPLES + negatives
    assert "drawn the grayer" in html
    assert "http" not in html
