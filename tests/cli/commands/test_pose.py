"""`nablahog pose` on a rendered chair in front of a photograph."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import ExifTags, Image

from nablahog import presets
from nablahog.cli.main import main
from nablahog.cli.results.pose_result import AZIMUTHS
from nablahog.io.images import write_image
from nablahog.pose.background import default_background
from nablahog.render import Mesh, sample_chairs
from tests.pose.common import SWIVEL, WOODEN, degrees_between, model, photographed

from ..common import names

AZIMUTH, ELEVATION = 130, 12
WEDGE = "OFF\n6 5 0\n0 0 0\n2 0 0\n2 1 0\n0 1 0\n0 1 2\n2 1 2\n4 0 1 2 3\n4 3 2 5 4\n4 4 5 1 0\n3 0 3 4\n3 1 5 2\n"
RESULTS = ["chair_elements.png", "chair_overlay.png", "chair_pose.json", "chair_similarity.svg", "index.html"]


def write_off(path: Path, mesh: Mesh) -> None:
    lines = ["OFF", f"{len(mesh.vertices)} {len(mesh.faces)} 0"]
    lines += [" ".join(map(str, vertex)) for vertex in mesh.vertices.tolist()]
    lines += ["3 " + " ".join(map(str, face)) for face in mesh.faces.tolist()]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def wedge(tmp_path: Path) -> str:
    """A model that is rendered in no time."""
    path = tmp_path / "wedge.off"
    path.write_text(WEDGE)
    return str(path)


@pytest.fixture
def scene(tmp_path: Path) -> list[str]:
    """The arguments that name the photograph, two models and a damaged one, and the box."""
    folder = tmp_path / "models"
    folder.mkdir()
    for name, seed in (("wooden", WOODEN), ("swivel", SWIVEL)):
        write_off(folder / f"{name}.off", model(seed))
    (folder / "bad.off").write_text("hello")
    image, box = photographed(model(), AZIMUTH, ELEVATION, behind="coffee")
    write_image(tmp_path / "chair.png", image)
    return [str(tmp_path / "chair.png"), "--mesh", str(folder), "--box", ",".join(f"{side:g}" for side in box)]


def red(path: Path, box: tuple[int, int, int, int] | None = None) -> int:
    """How many pixels are red."""
    levels = np.asarray(Image.open(path).convert("RGB").crop(box), dtype=int)
    return int(((levels[..., 0] > 180) & (levels[..., 1:] < 90).all(-1)).sum())


def test_the_best_of_several_models(tmp_path: Path, scene: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    photograph, out = Path(scene[0]), tmp_path / "new" / "out"
    before = photograph.read_bytes()
    assert main(["pose", *scene, f"--init=-20,{ELEVATION}", "-o", str(out)]) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith("nablahog pose: skipped: bad: ")
    assert printed.err.count("\n") == 1
    for text in ("wooden", "azimuth", f"Look at {out / 'index.html'}"):
        assert text in printed.out
    assert names(out) == RESULTS
    assert photograph.read_bytes() == before

    result = json.loads((out / "chair_pose.json").read_text())
    assert result["model"] == "wooden"
    assert degrees_between(result["azimuth"], AZIMUTH) < 2
    assert abs(result["elevation"] - ELEVATION) < 4
    assert result["candidates"] == ["swivel", "wooden"]
    assert result["warning"] is None
    assert list(result["passed_over"]) == ["bad"]
    assert result["image_size"] == [150, 180]
    assert result["settings"]["initial"] == [-20, ELEVATION]
    assert result["settings"]["mesh"] == scene[2]
    assert result["settings"]["descriptor"]["name"] == "aubry"
    assert {"azimuth", "distance", "focal_length", "x, y", "similarity"} <= set(result["definitions"])
    around = result["around"]
    assert [len(around[key]) for key in ("azimuths", "similarities", "derivatives")] == [AZIMUTHS] * 3
    best = around["azimuths"][int(np.argmax(around["similarities"]))]
    assert degrees_between(best, result["azimuth"]) <= 4
    assert {len(path["azimuths"]) for path in result["traces"]} <= {3, 4}
    assert degrees_between(result["traces"][0]["azimuths"][-1], result["azimuth"]) < 1
    assert len(result["elements"]["positions"]) == len(result["elements"]["discriminability"]) > 0

    assert red(out / "chair_overlay.png", (0, 0, 400, 400)) > 1000  # the box, and the outline
    assert red(out / "chair_elements.png") > 1000
    drawing = (out / "chair_similarity.svg").read_text()
    page = (out / "index.html").read_text()
    assert drawing in page
    assert drawing.count("data:image/png;base64,") == 8  # renderings below the curves
    assert page.count("data:image/png;base64,") == 4 + 8 + 4
    assert 'alt="The same with the outline of wooden at the pose found"' in page
    defined = re.findall(r"<dt>(\w+)</dt>", page)
    assert defined == [name for name in re.findall(r'<th scope="col".*?>(\w+)</th>', page) if name in defined]
    assert "http" not in re.sub(r"http://www.w3.org/[\w/]+", "", page)  # names of SVG, which nobody loads
    for text in (
        "Pose of chair.png",
        "<td>wooden</td>",
        "Degrees that the camera",
        "passed over: bad",
        "<dt>elevation</dt>",
        "azimuth -20°",
    ):
        assert text in page


def test_chairs_that_come_with_the_package(
    tmp_path: Path, scene: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    some = {name: mesh for name, mesh in sample_chairs().items() if name in ("wooden-0", "swivel-1", "stool-0")}
    monkeypatch.setattr("nablahog.cli.inputs.models.sample_chairs", lambda: some)
    image, box = photographed(some["swivel-1"], AZIMUTH, ELEVATION, behind="coffee")
    write_image(tmp_path / "chair.png", image)
    sides = ",".join(f"{side:g}" for side in box)
    to = ["--box", sides, f"--init=-20,{ELEVATION}", "-o", str(tmp_path / "out")]
    assert main(["pose", str(tmp_path / "chair.png"), *to]) == 0
    assert "swivel-1" in capsys.readouterr().out
    result = json.loads((tmp_path / "out" / "chair_pose.json").read_text())
    assert (result["model"], result["settings"]["mesh"]) == ("swivel-1", None)
    assert result["candidates"] == list(some)
    assert degrees_between(result["azimuth"], AZIMUTH) < 5
    assert "chairs that come with nablahog" in (tmp_path / "out" / "index.html").read_text()


def test_the_papers_method_as_json(
    tmp_path: Path, scene: list[str], wedge: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scene[2] = wedge
    out = tmp_path / "out"
    options = ["--method", "paper", "--init", f"120,{ELEVATION}", "--json", "-o", str(out)]
    assert main(["pose", *scene, *options]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "chair_pose.json").read_text())
    assert (printed["settings"]["method"], printed["settings"]["similarity"]) == ("paper", "patches")
    assert printed["candidates"] == ["wedge"]
    assert len(printed["traces"]) == 9
    assert max(value for path in printed["traces"] for value in path["similarities"]) == printed["similarity"]
    assert (out / "chair_similarity.svg").read_text().count('"l-path f-ground"') == 9  # rings: starts
    page = (out / "index.html").read_text()
    assert "the paths of the search" in page
    for text in ("<td>paper, cells of 8x8 pixels</td>", "<td>aubry, cells of 8x8 pixels</td>"):
        assert text in page
    around = printed["around"]
    derivatives, differences = (np.array(around[name]) for name in ("derivatives", "central_differences"))
    cosine = derivatives @ differences / np.linalg.norm(derivatives) / np.linalg.norm(differences)
    assert around["cosine"] == pytest.approx(cosine)
    assert around["cosine"] > max(0.8, around["opendr_cosine"])
    assert f"over ±0.1° is {cosine:.2f}" in page


def test_the_whole_photograph_with_another_background(
    tmp_path: Path, scene: list[str], wedge: str, capsys: pytest.CaptureFixture[str]
) -> None:
    background = tmp_path / "my.npz"
    default_background(presets.uoctti(16, colour="gray"), 4).save(background)
    options = ["--background", str(background), "--similarity", "whitened", "--method", "exhaustive", "--init", "0,10"]
    assert main(["pose", scene[0], "--mesh", wedge, *options, "-o", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["box"] == [0, 0, 180, 150]
    assert result["settings"]["background"] == str(background)
    assert result["settings"]["descriptor"]["name"] == "uoctti"
    assert result["renderings"] == 360
    assert result["azimuth"] % 1 == 0


def test_odd_names(tmp_path: Path, scene: list[str], wedge: str, capsys: pytest.CaptureFixture[str]) -> None:
    odd = os.fsdecode(b"\xff<b>[x]")
    photograph = tmp_path / f"{odd}.png"
    os.rename(scene[0], photograph)
    mesh = tmp_path / f"{odd}.off"
    os.rename(wedge, mesh)
    options = ["--method", "exhaustive", "--init", "0,10"]
    assert main(["pose", str(photograph), "--mesh", str(mesh), *options, "-o", str(tmp_path / "out")]) == 0
    assert r"\xff<b>[x]" in capsys.readouterr().out
    page = (tmp_path / "out" / "index.html").read_text()
    assert "&lt;b&gt;" in page
    assert "<b>" not in page
    assert "<b>[x]_pose.json" in os.listdir(tmp_path / "out")


def test_axes_of_the_model(tmp_path: Path, scene: list[str], wedge: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A wedge on its side in a file of y up, its front to +x, is the same object."""
    lines = WEDGE.splitlines()
    corners = [line.split() for line in lines[2:8]]
    # what is to the object's right, behind and above it: file -z, -x and +y
    on_its_side = tmp_path / "side.off"
    moved = [f"-{behind} {above} -{right}" for right, behind, above in corners]
    on_its_side.write_text("\n".join([*lines[:2], *moved, *lines[8:]]) + "\n")
    poses = []
    for path, axes in ((wedge, []), (str(on_its_side), ["--up", "y", "--front=+x"])):
        options = ["--method", "exhaustive", "--init", "0,10", *axes, "--json", "-o", str(tmp_path / "out")]
        assert main(["pose", scene[0], "--mesh", path, *options]) == 0
        printed = capsys.readouterr()
        poses.append(json.loads(printed.out))
        assert poses[-1]["similarity"] < 5  # a wedge is no chair
        assert printed.err == f"nablahog pose: warning: {poses[-1]['warning']}\n"
        assert poses[-1]["warning"] in (tmp_path / "out" / "index.html").read_text()
    assert [pose["azimuth"] for pose in poses] == [poses[0]["azimuth"]] * 2
    assert poses[1]["similarity"] == pytest.approx(poses[0]["similarity"])


def test_bad_inputs(tmp_path: Path, scene: list[str], refused: Callable[..., None]) -> None:
    photograph, _, folder, _, box = scene
    to = ["-o", str(tmp_path / "out")]

    def check(message: str, status: int = 1, **changes: Any) -> None:
        given: dict[str, Any] = {"mesh": folder, "box": box} | changes
        argv = [str(part) for key, value in given.items() for part in (f"--{key}={value}",)]
        refused("pose", photograph, *argv, *to, message=message, status=status)

    check("the box must lie in the image of 150x180 pixels", box="200,0,300,100")
    check("sides of at least 8 pixels", box="0,0,5,100")
    check("expected the numbers x0,y0,x1,y1, got '1,2,3'", 2, box="1,2,3")
    check("expected the numbers x0,y0,x1,y1, got '0,0,inf,9'", 2, box="0,0,inf,9")
    check("expected the numbers az,el, got '10'", 2, init="10")
    check("expected the numbers az,el, got 'a,b'", 2, init="a,b")
    check("expected an elevation in -90…90 degrees, got '0,91'", 2, init="0,91")
    check("invalid choice: 'fast'", 2, method="fast")
    check("invalid choice: 'cosine'", 2, similarity="cosine")
    check("expected x, y or z, with a sign or without, got 'up'", 2, up="up")
    check("up and front must be two axes, got 'z' and '-z'", up="z", front="-z")
    check("no.off: no such file", mesh=tmp_path / "no.off")
    check("models/bad.off: ", mesh=Path(folder, "bad.off"))
    check("expected a mesh file (.off, .obj, .ply, .stl, .glb), got the ending '.png'", mesh=photograph)
    check("no.npz: no such file", background=tmp_path / "no.npz")
    check("bad.off: expected", background=Path(folder, "bad.off"))
    (tmp_path / "empty").mkdir()
    check("expected a folder of CAD models", mesh=tmp_path / "empty")
    for name in ("a.off", "b.ply"):
        (tmp_path / "empty" / name).write_text("hello")
    check("no model can be read; the first: ", mesh=tmp_path / "empty")
    small = tmp_path / "small.npz"
    default_background(presets.aubry(16), 2).save(small)
    check("visual elements of 5x5 cells in pictures of 128x128 pixels, got one of order 2", background=small)
    refused("pose", folder, "--mesh", folder, *to, message="expected an image file, got a folder")
    refused("pose", str(tmp_path / "no.png"), "--mesh", folder, *to, message="no.png: no such file")
    refused("pose", photograph, "--mesh", folder, "-o", photograph, message="is not a folder")
    for axis in (["--up", "y"], ["--front=-x"]):
        refused("pose", photograph, *axis, *to, message="--up and --front say how the files of --mesh lie")


def test_it_never_overwrites_an_input(tmp_path: Path, scene: list[str], refused: Callable[..., None]) -> None:
    page = tmp_path / "index.html"  # Pillow does not mind the name
    os.rename(scene[0], page)
    refused("pose", str(page), *scene[1:], "-o", str(tmp_path), message="would overwrite an input")


def test_what_fails_leaves_nothing(
    tmp_path: Path, scene: list[str], wedge: str, refused: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*args: object, **options: object) -> None:
        raise MemoryError

    monkeypatch.setattr("nablahog.cli.results.pose_page.silhouette", fail)
    options = ["--method", "exhaustive", "--init", "0,10", "-o", str(tmp_path / "out")]
    refused("pose", scene[0], "--mesh", wedge, *options, message="not enough memory")


def test_without_a_box_the_object_is_looked_for(scene: list[str], tmp_path: Path) -> None:
    photo, _, folder, *_, box = scene
    assert main(["pose", photo, "--mesh", f"{folder}/wooden.off", "-o", str(tmp_path / "out"), "--init", "0,12"]) == 0
    figures = json.loads((tmp_path / "out" / "chair_pose.json").read_text())
    assert degrees_between(figures["azimuth"], AZIMUTH) < 3
    assert max(abs(a - float(b)) for a, b in zip(figures["box"], box.split(","), strict=True)) < 15
    assert 0.5 < figures["confidence"] <= 1
    assert not figures["refused"]
    assert not figures["any_azimuth"]


def test_a_pose_that_is_not_sure_is_refused(
    scene: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """There is no chair in the photograph."""
    empty, out = tmp_path / "empty.png", tmp_path / "out"
    Image.fromarray(np.full((120, 120), 128, np.uint8)).save(empty)
    assert main(["pose", str(empty), *scene[1:3], "--box", "10,10,110,110", "-o", str(out)]) == 4
    assert "nablahog pose: refused: the azimuth is within 15 degrees" in capsys.readouterr().err
    assert json.loads((out / "empty_pose.json").read_text())["refused"]
    arguments = [str(empty), *scene[1:3], "--box", "10,10,110,110", "-o", str(out), "--least-confidence", "0"]
    assert main(["pose", *arguments]) == 0


@pytest.mark.parametrize("text", ["1.5", "-0.1", "much"])
def test_a_confidence_is_a_probability(text: str, wedge: str, tmp_path: Path) -> None:
    arguments = ["x.png", "--mesh", wedge, "-o", str(tmp_path / "out"), f"--least-confidence={text}"]
    assert main(["pose", *arguments]) == 2


def test_the_lens_and_the_initial_azimuth_are_taken(scene: list[str], tmp_path: Path) -> None:
    """The photograph is made with a focal length of 300 pixels, 2.8 away."""
    photo, _, folder, _, box = scene
    common = ["pose", photo, "--mesh", f"{folder}/wooden.off", "--box", box, f"--init={AZIMUTH + 20},{ELEVATION}"]
    assert main([*common, "--within", "40", "--focal", "300", "-o", str(tmp_path / "focal")]) == 0
    figures = json.loads((tmp_path / "focal" / "chair_pose.json").read_text())
    assert degrees_between(figures["azimuth"], AZIMUTH) < 3
    assert figures["focal_length"] == pytest.approx(300)
    assert figures["distance"] == pytest.approx(2.8, abs=0.15)
    assert main([*common, "--field-of-view", "28.07", "-o", str(tmp_path / "view")]) == 0
    assert json.loads((tmp_path / "view" / "chair_pose.json").read_text())["focal_length"] == pytest.approx(
        300, abs=0.1
    )


def test_the_camera_of_the_file_is_taken(scene: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo, _, folder, _, box = scene
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 1  # without any tag of its own, Pillow writes none to a PNG
    exif[ExifTags.IFD.Exif] = {ExifTags.Base.FocalLengthIn35mmFilm: 50}
    Image.open(photo).save(photo, exif=exif)
    common = ["pose", photo, "--mesh", f"{folder}/wooden.off", "--box", box, "--init", "0,10", "--json"]
    common += ["--method", "exhaustive", "-o", str(tmp_path / "out")]
    figures = []
    for more in ([], ["--focal", "exif", "--principal-point", "80,70"], ["--focal", "unknown"], ["--focal", "300"]):
        assert main([*common, *more]) == 0
        figures.append(json.loads(capsys.readouterr().out))
    assert [each["focal_length_from"] for each in figures] == ["exif", "exif", "assumed", "given"]
    assert figures[0]["focal_length"] == pytest.approx(50 / np.hypot(36, 24) * np.hypot(150, 180))
    assert [each["principal_point"] for each in figures] == [[90, 75], [80, 70], None, [90, 75]]
    assert figures[3]["intrinsics"] == [[300, 0, 90], [0, 300, 75], [0, 0, 1]]
    assert np.shape(figures[0]["matrix"]) == (4, 4)
    extent = np.ptp(model().vertices.numpy(), axis=0)  # the file has them as they are
    assert figures[3]["distance_in_file_units"] == pytest.approx(figures[3]["distance"] * np.linalg.norm(extent))


def test_a_camera_that_the_file_does_not_know(scene: list[str], refused: Callable[..., None], tmp_path: Path) -> None:
    to = ["-o", str(tmp_path / "out")]
    refused("pose", *scene, *to, "--focal", "exif", message="its EXIF data has no focal length")
    refused("pose", *scene, *to, "--principal-point", "80,70", message="--principal-point needs a known focal length")
    refused("pose", *scene, *to, "--mask", scene[2], message="expected an image file, got a folder")


def test_a_mask_takes_the_place_of_the_box(scene: list[str], tmp_path: Path) -> None:
    clean, box = photographed(model(), AZIMUTH, ELEVATION)
    write_image(tmp_path / "mask.png", (clean < 0.999).float())
    command = ["pose", scene[0], "--mesh", f"{scene[2]}/wooden.off", "--mask", str(tmp_path / "mask.png")]
    assert main([*command, "-o", str(tmp_path / "out")]) == 0
    figures = json.loads((tmp_path / "out" / "chair_pose.json").read_text())
    assert max(abs(one - other) for one, other in zip(figures["box"], box, strict=True)) <= 1
    assert degrees_between(figures["azimuth"], AZIMUTH) < 2


@pytest.mark.parametrize("option", ["--within=0", "--within=200", "--focal=-3", "--field-of-view=180", "--focal=far"])
def test_a_lens_is_a_number(option: str, wedge: str, tmp_path: Path) -> None:
    assert main(["pose", "x.png", "--mesh", wedge, "-o", str(tmp_path / "out"), option]) == 2
