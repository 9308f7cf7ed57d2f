"""`nablahog pose`: one object or many, in front of photographs."""

from __future__ import annotations

import base64
import csv
import json
import os
import re
from collections.abc import Callable
from html import unescape
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import ExifTags, Image

from nablahog.cli.commands import pose
from nablahog.cli.main import main
from nablahog.cli.results.pose_files import PosedObject
from nablahog.inputs.boxes import Box
from nablahog.inputs.cameras import advise_on_size
from nablahog.io.images import write_image
from nablahog.io.lists import AnnotatedObject
from nablahog.pose.result import DOUBT
from nablahog.render.models import Model, save_meshes
from nablahog.requests.pose import PoseRequest
from tests.pose.common import SWIVEL, degrees_between, model, photographed

from ..common import WEDGE, names, write_chairs

AZIMUTH, ELEVATION = 130, 12
RESULTS = ["index.html", "poses.csv", "poses.json"]
Run = Callable[..., dict[str, Any]]


@pytest.fixture
def wedge(tmp_path: Path) -> str:
    """A model that is rendered in no time."""
    path = tmp_path / "wedge.off"
    path.write_text(WEDGE)
    return str(path)


@pytest.fixture
def scene(tmp_path: Path) -> list[str]:
    """The arguments that name the photograph, its model and the box; another model and a damaged one are beside it."""
    folder = write_chairs(tmp_path / "models")
    (folder / "bad.off").write_text("hello")
    image, box = photographed(model(), AZIMUTH, ELEVATION, behind="coffee")
    write_image(tmp_path / "chair.png", image)
    sides = ",".join(f"{side:g}" for side in box)
    return [str(tmp_path / "chair.png"), "--mesh", str(folder / "wooden.off"), "--box", sides]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Runs the command with results in the folder ``out``; the figures of the only object."""

    def run_command(*words: str, status: int = 0) -> dict[str, Any]:
        assert main(["pose", *words, "-o", str(tmp_path / "out")]) == status
        (only,) = json.loads((tmp_path / "out" / "poses.json").read_text())["annotations"]
        return only  # type: ignore[no-any-return]

    return run_command


def read_row(tmp_path: Path) -> dict[str, str]:
    (row,) = csv.DictReader((tmp_path / "out" / "poses.csv").read_text().splitlines())
    return row


@pytest.mark.slow
def test_the_best_of_several_models(
    tmp_path: Path, scene: list[str], run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    photograph, out = Path(scene[0]), tmp_path / "out"
    before, scene[2] = photograph.read_bytes(), str(tmp_path / "models")
    result = run(*scene, f"--init=-20,{ELEVATION}", "--page")
    printed = capsys.readouterr()
    assert printed.err.startswith("nablahog pose: skipped: bad: ")
    assert printed.err.count("\n") == 1
    for text in ("wooden", "azimuth", "Focal length assumed, so the distance", str(out / "index.html")):
        assert text in printed.out
    assert names(out) == sorted([*RESULTS, "object_1.html"])
    assert photograph.read_bytes() == before

    assert result["model"] == "wooden"
    assert degrees_between(result["azimuth"], AZIMUTH) < 2
    assert abs(result["elevation"] - ELEVATION) < 4
    assert result["warning"] is None
    whole = json.loads((out / "poses.json").read_text())
    assert [whole["images"][0][side] for side in ("height", "width")] == [150, 180]

    page = (out / "object_1.html").read_text()
    assert page.count("data:image/png;base64,") == 4 + 8 + 4
    assert 'alt="The same with the outline of wooden at the pose found"' in page
    assert "http" not in re.sub(r"http://www.w3.org/[\w/]+", "", page)  # names of SVG, which nobody loads
    for text in ("Pose of chair.png", "<td>wooden</td>", "swivel, wooden", "<dt>elevation</dt>", "<td>assumed</td>"):
        assert text in page
    index = (out / "index.html").read_text()
    assert '<a href="index.html">' in page
    assert '<a href="object_1.html">chair.png</a>' in index
    assert "<dt>id, image_id, category_id</dt>" in index
    assert "<dt>second</dt>" not in index  # a column without any value
    for text in ("the mean of those of the best models, eight at most", "Focal length assumed"):
        assert text in page
        assert text in index
    (shown_picture,) = re.findall('data:image/png;base64,([^"]+)', index)
    joined = np.asarray(Image.open(BytesIO(base64.b64decode(shown_picture)))).astype(int)
    close, whole_picture = joined[:, :240], joined[:, 240:]
    assert whole_picture.shape == (240, 288, 3)  # as the photograph of 150x180
    shown = Image.open(photograph).convert("RGB").resize((288, 240), Image.Resampling.BILINEAR)
    unlike = np.abs(whole_picture - np.asarray(shown)).max(2) > 30
    assert 0.005 < unlike.mean() < 0.1  # the outline and the box alone
    red, blue = is_red(whole_picture[unlike]).mean(), is_red(whole_picture[unlike, ::-1]).mean()
    assert red > 0.2 < blue  # the outline and the box
    assert red + blue > 0.9
    assert is_red(close).mean() > 0.005


def is_red(pixels: NDArray[np.int_]) -> NDArray[np.bool_]:
    return (pixels[..., 0] > 200) & (pixels[..., 1:].max(-1) < 170) & (pixels[..., 2] < 100)


def test_chairs_that_come_with_the_package(
    tmp_path: Path, run: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    save_meshes(tmp_path / "chairs.npz", {"swivel-1": model(SWIVEL), "wooden-0": model()})
    monkeypatch.setattr(pose, "SAMPLE_CHAIRS", tmp_path / "chairs.npz")
    image, box = photographed(model(SWIVEL), AZIMUTH, ELEVATION, behind="coffee")
    write_image(tmp_path / "chair.png", image)
    result = run(str(tmp_path / "chair.png"), "--box", ",".join(map(str, box)), f"--init=-20,{ELEVATION}")
    assert "swivel-1" in capsys.readouterr().out
    assert result["model"] == "swivel-1"
    assert degrees_between(result["azimuth"], AZIMUTH) < 5


@pytest.mark.slow
def test_the_papers_method(tmp_path: Path, scene: list[str], wedge: str, run: Run) -> None:
    scene[2] = wedge
    assert run(*scene, "--method", "paper", "--init", f"120,{ELEVATION}", "--page")["similarity_kind"] == "patches"
    page = (tmp_path / "out" / "object_1.html").read_text()
    assert page.count('"l-path f-ground"') == 9  # rings: starts
    for text in ("the paths of the search", *(f"<td>{spec}, cells of 8x8 pixels</td>" for spec in ("paper", "aubry"))):
        assert text in page


def test_odd_names(tmp_path: Path, scene: list[str], wedge: str, run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    odd = os.fsdecode(b"\xff<b>[x]")
    photograph, mesh = tmp_path / f"{odd}.png", tmp_path / f"{odd}.off"
    os.rename(scene[0], photograph)
    os.rename(wedge, mesh)
    run(str(photograph), "--mesh", str(mesh), "--method", "exhaustive", "--init", "0,10", "--page")
    assert r"\xff<b>[x]" in capsys.readouterr().out
    for name in ("index.html", "object_1.html"):
        page = (tmp_path / "out" / name).read_text()
        assert "&lt;b&gt;" in page
        assert "<b>" not in page


def test_axes_of_the_model(
    tmp_path: Path, scene: list[str], wedge: str, run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    """A wedge on its side in a file of y up, its front to +x, is the same object."""
    lines = WEDGE.splitlines()
    corners = [line.split() for line in lines[2:8]]
    # what is to the object's right, behind and above it: file -z, -x and +y
    on_its_side = tmp_path / "side.off"
    moved = [f"-{behind} {above} -{right}" for right, behind, above in corners]
    on_its_side.write_text("\n".join([*lines[:2], *moved, *lines[8:]]) + "\n")
    poses = []
    for path, axes in ((wedge, []), (str(on_its_side), ["--up", "y", "--front=+x"])):
        poses.append(run(scene[0], "--mesh", path, "--method", "exhaustive", "--init", "0,10", *axes))
        assert poses[-1]["bbox"] == [0, 0, 180, 150]
        assert poses[-1]["similarity"] < 5  # a wedge is no chair
        said = capsys.readouterr().err
        assert said.startswith(f"nablahog pose: warning: {poses[-1]['warning']}; give a rough box")
        assert ("--up y" in said) == (not axes)
    assert poses[1]["azimuth"] == poses[0]["azimuth"]
    assert poses[1]["similarity"] == pytest.approx(poses[0]["similarity"])


def test_advice_on_a_warning_fits_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A model on its side is a cause only of doubt; a wrong azimuth and a missing box are likelier ones."""
    doubt, size = f"the confidence is 0.10: {DOUBT}", advise_on_size(150, 180, 180, 150)
    models = [Model("wedge", tmp_path / "wedge.off")]
    advice = []
    box = Box(1, 2, 3, 4)
    for warning, within, view, given in (
        (doubt, 30, (0, 10), None),
        (doubt, 180, (0, 10), box),
        (doubt, 30, None, None),
        (size, 30, (0, 10), None),
    ):
        request = PoseRequest(mesh="wedge.off", initial=view or (0, 10), within=within)
        posed = PosedObject(AnnotatedObject(1, "a.png", given, view), {"warning": warning})
        assert pose._status([posed], request, models) == 0
        said = capsys.readouterr().err
        advice.append([said.find(option) for option in ("--within", "--box", "--up y")])
    assert 0 < advice[0][0] < advice[0][1] < advice[0][2]
    assert [[place > 0 for place in places] for places in advice[1:]] == [
        [False, False, True],
        [False, True, True],
        [False, False, False],
    ]


def test_what_is_said_of_several_objects(capsys: pytest.CaptureFixture[str]) -> None:
    """How many are doubtful and refused; a failure counts more than a refusal."""
    listed, request = AnnotatedObject(1, "a.png"), PoseRequest(least_confidence=0.5)
    doubtful = PosedObject(listed, {"warning": DOUBT}, refused=True)
    fine, failed = PosedObject(listed, {"warning": None}), PosedObject(listed, failure="no such file")
    for posed, status, many in (
        ([fine], 0, 0),
        ([doubtful], 4, 1),
        ([fine, doubtful], 4, 2),
        ([doubtful, failed], 3, 2),
    ):
        assert pose._status(posed, request, []) == status
        said = capsys.readouterr().err
        assert bool(said) == (doubtful in posed)
        assert ("1 of 2 objects; the first: " in said) == ("1 of 2 poses" in said) == (many == 2)
        assert ("the pose is refused" in said) == (many == 1)


def test_bad_inputs(tmp_path: Path, scene: list[str], refused: Callable[..., None]) -> None:
    folder, cameras = Path(scene[2]).parent, tmp_path / "cameras.txt"
    cameras.write_text("1 SIMPLE_RADIAL 360 300 600 180 152 -0.1\n")
    (tmp_path / "empty").mkdir()
    for message, status, *words in (
        ("written --init=-", 2, "--init", "-30,10"),
        ("--up must be one of 'x', 'y', 'z'", 2, "--up", "up"),
        ("got 'z' and '-z'", 2, "--up", "z", "--front=-z"),
        ("models/bad.off: ", 1, "--mesh", f"{folder}/bad.off"),
        ("expected a folder of CAD models", 1, "--mesh", str(tmp_path / "empty")),
        ("whose EXIF data has one", 1, "--focal", "exif"),
        ("--within needs --init", 2, "--within", "20"),
        ("leave --focal and --principal-point out", 2, "--intrinsics", "300,300,90,75", "--focal", "300"),
        ("write --intrinsics=300,300,90,76 and --distortion=-0.1,0,0,0,0", 1, "--intrinsics", str(cameras)),
    ):
        refused("pose", *scene, *words, "-o", str(tmp_path / "out"), message=message, status=status)
    refused("pose", scene[0], "--up", "y", "-o", str(tmp_path / "out"), message="--up and --front", status=2)


def test_without_a_box_the_object_is_looked_for(scene: list[str], run: Run) -> None:
    x0, y0, x1, y1 = map(float, scene[4].split(","))
    result = run(*scene[:3], "--init", "0,12")
    assert degrees_between(result["azimuth"], AZIMUTH) < 3
    assert np.abs(np.subtract(result["bbox"], [x0, y0, x1 - x0, y1 - y0])).max() < 15
    assert 0.5 < result["confidence"] <= 1
    assert not result["refused"]


@pytest.mark.slow
def test_a_pose_that_is_not_sure_is_refused(
    scene: list[str], tmp_path: Path, run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    """There is no chair in the photograph."""
    scene[0] = str(tmp_path / "empty.png")
    Image.fromarray(np.full((120, 120), 128, np.uint8)).save(scene[0])
    scene[4] = "10,10,110,110"
    result = run(*scene, status=4)
    assert "nablahog pose: the pose is refused, with a confidence below" in capsys.readouterr().err
    assert result["refused"]
    assert result["warning"] in (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    run(*scene, "--least-confidence", "0")


def test_where_the_focal_length_is_from(scene: list[str], run: Run) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 1  # without any tag of its own, Pillow writes none to a PNG
    exif[ExifTags.IFD.Exif] = {ExifTags.Base.FocalLengthIn35mmFilm: 50}
    Image.open(scene[0]).save(scene[0], exif=exif)
    search = ["--method", "exhaustive", f"--init={AZIMUTH + 20},{ELEVATION}"]
    poses = [
        run(*scene, *search, *more)
        for more in (["--focal", "exif", "--principal-point", "80,70"], ["--focal", "unknown"], [])
    ]
    assert [each["focal_length_from"] for each in poses] == ["exif", "assumed", "exif"]
    assert poses[0]["focal_length"] == pytest.approx(50 / np.hypot(36, 24) * np.hypot(150, 180))
    assumed = [90 + poses[1]["x"], 75 + poses[1]["y"]]
    assert [each["principal_point"] for each in poses] == [[80, 70], assumed, [90, 75]]
    assert [[each["intrinsics"][k][2] for k in range(2)] for each in poses] == [[80, 70], assumed, [90, 75]]


@pytest.mark.slow
def test_lens_and_initial_azimuth_are_taken_and_standard_deviations_are_beside_the_figures(
    scene: list[str], tmp_path: Path, run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    """The photograph is made with a focal length of 300 pixels, 2.8 away."""
    result = run(*scene, f"--init={AZIMUTH + 20},{ELEVATION}", "--within", "40", "--focal", "300", "--page")
    printed, deviations = capsys.readouterr().out, result["standard_deviations"]
    assert degrees_between(result["azimuth"], AZIMUTH) < min(3, 4 * deviations["azimuth"])
    assert abs(result["distance"] - 2.8) < min(0.15, 4 * deviations["distance"])
    assert result["intrinsics"] == [[300, 0, 90], [0, 300, 75], [0, 0, 1]]
    assert (result["focal_length_from"], result["principal_point"]) == ("given", [90, 75])
    extent = np.ptp(model().vertices.numpy(), axis=0)  # the file has them as they are
    assert result["distance_in_file_units"] == pytest.approx(result["distance"] * np.linalg.norm(extent))
    assert np.linalg.norm(result["position"]) == pytest.approx(result["distance_in_file_units"])
    assert result["position_std"][2] == pytest.approx(deviations["distance_in_file_units"], rel=0.05)
    row = read_row(tmp_path)
    assert float(row["azimuth_std"]) == deviations["azimuth"]
    assert float(row["position_z_std"]) == result["position_std"][2]
    shown = f" ± {deviations['azimuth']:.2f}" if deviations["azimuth"] < 1 else f" ± {deviations['azimuth']:.1f}"
    for text in (printed, *((tmp_path / "out" / name).read_text() for name in ("index.html", "object_1.html"))):
        for said in (shown, f"{result['position'][2]:.3f} ± ", "z, units of", "half_turn"):
            assert said in unescape(text)
    assert not re.search(r"\de-\d", printed)  # probabilities that nobody measured
    run(*scene, "--focal", "unknown")
    assert "units of" not in capsys.readouterr().out
    row = read_row(tmp_path)
    assert row["distance_std"] == row["position_x_std"] == ""
    assert float(row["position_z"]) == float(row["distance_in_file_units"])
    assert float(row["azimuth_std"]) > 0
    assert run(*scene, "--method", "exhaustive", "--page")["covariance"] is None
    assert read_row(tmp_path)["azimuth_std"] == ""


@pytest.mark.slow
def test_the_files_of_a_calibrated_camera(tmp_path: Path, scene: list[str], run: Run) -> None:
    """Numbers, COLMAP's file and OpenCV's ask for the same; boxes are in pixels of the photograph, as it is."""
    (tmp_path / "cameras.txt").write_text("# one\n7 OPENCV 180 150 300 290 92 73 -0.2 0.05 0.001 0\n")
    coefficients = {"rows": 1, "cols": 5, "data": [-0.2, 0.05, 0.001, 0, 0]}
    matrix = [[300.0, 0.0, 92.0], [0.0, 290.0, 73.0], [0.0, 0.0, 1.0]]
    camera = {"camera_matrix": {"data": [*matrix[0], *matrix[1], *matrix[2]]}, "distortion_coefficients": coefficients}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    poses = [
        run(*scene, "--init", f"{AZIMUTH},{ELEVATION}", "--page", "--intrinsics", *words)
        for words in (
            ("300,290,92,73", "--distortion=-0.2,0.05,0.001,0"),
            (str(tmp_path / "cameras.txt"),),
            (str(tmp_path / "camera.json"),),
        )
    ]
    for each in poses:
        del each["seconds"]
    assert poses[0] == poses[1] == poses[2]
    x0, y0, width, height = poses[0]["bbox"]
    assert [x0, y0, x0 + width, y0 + height] == [float(side) for side in scene[4].split(",")]
    assert degrees_between(poses[0]["azimuth"], AZIMUTH) < 5
    assert poses[0]["photograph_camera"]["camera_matrix"] == matrix
    assert poses[0]["focal_length_from"] == "given"
    whole = json.loads((tmp_path / "out" / "poses.json").read_text())
    assert [(image["height"], image["width"]) for image in whole["images"]] == [(150, 180)]
    page = (tmp_path / "out" / "object_1.html").read_text(encoding="utf-8")
    assert "undistorted, as the box is" in page
    assert "<td>given</td>" in page
    assert page.count(f"{poses[0]['similarity']:.3g}") >= 2  # in the table, and where the figure's differs


def test_a_mask_takes_the_place_of_the_box(scene: list[str], tmp_path: Path, run: Run) -> None:
    clean, box = photographed(model(), AZIMUTH, ELEVATION)
    write_image(tmp_path / "mask.png", (clean < 0.999).float())
    result = run(*scene[:3], "--mask", str(tmp_path / "mask.png"))
    expected = [box.x0, box.y0, box.width, box.height]
    assert max(abs(one - other) for one, other in zip(result["bbox"], expected, strict=True)) <= 2
    assert degrees_between(result["azimuth"], AZIMUTH) < 2
