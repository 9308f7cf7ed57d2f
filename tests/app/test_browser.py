"""The page in a real browser, clicked through; skipped where there is no Chromium with its driver."""

from __future__ import annotations

import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage import data, feature

from nablahog import load_descriptor
from nablahog.compat.opencv import HOGDescriptor

from .browser import CHROMIUM, DRIVER, WAIT, Page, browsing, serving

JS = Path(__file__).with_name("js")
AXE = JS / "node_modules" / "axe-core" / "axe.min.js"
TSC = JS / "node_modules" / ".bin" / "tsc"
in_a_browser = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None, reason="no Chromium with its driver: the page is not tested in a browser"
)
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of the driver
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.xdist_group("browser"),  # one browser, one worker
]


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with serving() as made:
        yield made


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("browser")


@pytest.fixture(scope="module")
def browser(address: str, folder: Path) -> Iterator[Page]:
    with browsing(folder) as driver:
        yield Page(driver, address)


@pytest.fixture
def page(browser: Page) -> Iterator[Page]:
    """The page; after each test, the console is free of errors, and nothing was asked of others."""
    browser.requested()
    browser.complaints()
    yield browser
    schemes = [f"{scheme}:" for scheme in ("data", "blob", "about", "chrome", "chrome-untrusted")]
    own = (browser.address, browser.address.replace("http", "ws"), *schemes)
    assert [url for url in browser.requested() if not url.startswith(own)] == []
    assert browser.complaints() == []


def wait_for_file(folder: Path, ending: str) -> None:
    end = time.monotonic() + WAIT
    while not list(folder.glob(f"*{ending}")):
        assert time.monotonic() < end, f"no {ending} was downloaded"
        time.sleep(0.1)


def refused_and_expected(page: Page) -> None:
    """Answers that are no success are told by the console, too, as they should be here."""
    assert all("422" in each for each in page.complaints())


def drop(page: Page, **contents: str) -> None:
    """Drops files of these names, with a dot for each underscore, and contents."""
    files = ", ".join(f"new File([{json.dumps(text)}], '{name.replace('_', '.')}')" for name, text in contents.items())
    page.read(
        f"(() => {{ const dropped = new DataTransfer(); for (const file of [{files}]) dropped.items.add(file);"
        "document.dispatchEvent(new DragEvent('drop', { dataTransfer: dropped, cancelable: true })); })()"
    )


@pytest.mark.slow
@in_a_browser
def test_see(page: Page, folder: Path) -> None:
    page.open("#/see?photo=sample-camera&preset=uoctti&size=128")
    page.until("document.querySelector('#glyphs').dataset.key")
    first = page.read("document.querySelector('#glyphs').dataset.key")
    page.enter("#controls [name=cell_size]", 16)
    page.until(f"document.querySelector('#glyphs').dataset.key !== {json.dumps(first)}")
    page.idle()
    assert "8x8" in page.text("#shape").replace(" × ", "x").replace("×", "x")
    page.press("#glyphs", "ArrowRight")
    page.until("document.querySelector('#cell table')")
    assert "directed: 0°" in page.text("#cell")
    assert "nablahog hog" in page.text("#see-snippets")
    page.click("#see-download")
    page.idle()
    wait_for_file(folder / "downloads", ".npz")
    assert load_descriptor(next((folder / "downloads").glob("*.npz"))).descriptor.shape == (8, 8, 31)


@pytest.mark.slow
@in_a_browser
def test_a_dropped_array_is_asked_about(page: Page, tmp_path: Path) -> None:
    """One row, which no normaliser has made: the presets whose descriptors have its length come first."""
    row = feature.hog(data.camera()[100:164, 200:264], cells_per_block=(2, 2)).astype(np.float32)
    np.save(tmp_path / "mine.npy", row * np.random.default_rng(0).uniform(1, 2, row.size))
    page.open("#/see")
    page.driver.find_element("id", "file").send_keys(str(tmp_path / "mine.npy"))
    page.until("!document.querySelector('#question').hidden")
    assert "which library" in page.text("#question")
    page.enter("#question-settings", "depth=3")
    page.read("document.querySelector('#question').requestSubmit()")
    page.until("document.querySelector('#alert').textContent.includes('depth')")
    page.enter("#question-settings", "")  # of the form, which is still there
    page.read("document.querySelector('#question').requestSubmit()")
    page.until("document.querySelector('#shape').textContent.includes('paper')")
    page.idle()
    refused_and_expected(page)


@pytest.mark.slow
@in_a_browser
def test_a_photograph_is_dropped(page: Page, tmp_path: Path, photo_file: bytes) -> None:
    (tmp_path / "mine.png").write_bytes(photo_file)
    page.open("#/see")
    page.driver.find_element("id", "file").send_keys(str(tmp_path / "mine.png"))
    page.until("document.querySelector('#see-snippets').textContent.includes('nablahog hog mine.png')")
    page.idle()
    page.until("location.hash.includes('mine.png')")
    address = page.driver.current_url
    page.open(f"#{address.partition('#')[2]}")  # a reload returns to it
    page.until("document.querySelector('#see-snippets').textContent.includes('nablahog hog mine.png')")
    page.idle()
    Image.new("L", (5, 5)).save(tmp_path / "tiny.png")
    page.driver.find_element("id", "file").send_keys(str(tmp_path / "tiny.png"))
    page.until("document.querySelector('#see-shown').hidden && document.querySelector('#alert').textContent")
    assert "5" in page.text("#alert")
    (tmp_path / "broken.png").write_bytes(b"no image")
    page.driver.find_element("id", "file").send_keys(str(tmp_path / "broken.png"))
    page.until("document.querySelector('#alert').textContent.includes('broken.png: expected an image')")
    assert "tiny.png stays open" in page.text("#alert")
    refused_and_expected(page)


@pytest.mark.slow
@in_a_browser
def test_what_is_dropped_ends_what_was_dropped_before(page: Page, tmp_path: Path) -> None:
    page.open("#/fit?photo=scene-chair")
    page.idle()
    drop(page, m_off="OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n")
    page.until("document.querySelector('#mesh-about').textContent.includes('m.off')")
    drop(page, cameras_txt="1 PINHOLE 224 224 320 300 100 120")
    page.until("document.querySelector('#intrinsics').value === '320, 300, 100, 120'")
    detector = HOGDescriptor()
    detector.setSVMDetector(np.linspace(-1, 1, 3781, dtype=np.float32))
    detector.save(str(tmp_path / "people.json"))
    people = (tmp_path / "people.json").read_text(encoding="utf-8")
    drop(page, people_json=people)
    page.until("document.querySelector('#source-name').textContent.includes('detector template')")
    for name, disabled in (("quality", True), ("method", True), ("prior", True), ("seed", False)):
        assert page.read(f"document.querySelector('#invert-{name}').disabled") == disabled
    drop(page, other_json=people)
    drop(page, a_png="x", b_png="x")
    page.idle()
    assert "got 2" in page.text("#alert")
    assert "people" in page.text("#source-name")
    drop(page, cam_yml="%YAML:1.0")
    page.until("document.querySelector('#alert').textContent.includes('cam.yml')")
    assert len(page.complaints()) == 1  # the page tells the console that there were two


@pytest.mark.slow
@in_a_browser
def test_a_camera_is_dropped_on_another_view(page: Page) -> None:
    for width, end in (
        (224, "document.querySelector('#intrinsics').value === '320, 300, 100, 120'"),
        (9, "document.querySelector('#alert').textContent.includes('cameras.txt')"),
    ):
        page.open("#/see?photo=scene-chair")
        page.idle()
        drop(page, cameras_txt=f"1 PINHOLE {width} {width} 320 300 100 120")
        page.until("!document.querySelector('#fit').hidden")
        page.until(end)
        page.idle()
        assert page.read(end)
    refused_and_expected(page)


@pytest.mark.slow
@in_a_browser
def test_invert(page: Page) -> None:
    page.open("#/invert?photo=sample-camera&preset=uoctti&size=96&quality=best&prior=none")
    page.read("document.querySelector('#invert-start').focus()")
    page.click("#invert-start")
    page.until("document.querySelector('#preimage').dataset.state === 'done'")
    page.idle()
    assert page.read("document.activeElement.id") == "invert-start"
    assert int(page.read("document.querySelector('#preimage').dataset.frames")) > 2
    assert "SSIM" in page.text("#figures")
    assert page.read("document.querySelector('#wipe input') !== null")
    assert "nablahog invert" in page.text("#invert-snippets")
    page.click("#invert-go-on")
    page.until("document.querySelector('#preimage').dataset.state === 'running'")
    page.click("#invert-stop")
    page.until("document.querySelector('#preimage').dataset.state !== 'running'")
    page.idle()


@pytest.mark.slow
@in_a_browser
def test_fit(page: Page, folder: Path) -> None:
    page.open("#/fit")  # begins with a photograph of a chair
    page.until("document.querySelector('#source-name').textContent.includes('chair')")
    assert page.read("document.querySelector('#principal-x').disabled")  # without a focal length
    for name, value in (("#focal", 400), ("#principal-x", 110.5), ("#principal-y", 113)):
        page.enter(name, value)
    page.until("location.hash.includes('axis=110.5')")
    page.click("#fit-open")
    page.until("document.querySelector('#scene').dataset.n > 0")
    page.idle()
    before = int(page.read("document.querySelector('#scene').dataset.n"))
    page.enter("#pose-azimuth", 60)
    page.until(f"document.querySelector('#scene').dataset.n > {before}")
    page.press("#scene", "ArrowLeft")
    page.idle()
    assert "the largest is" in page.read("document.querySelector('#curve img').alt")
    page.read(
        "((chart, box = chart.getBoundingClientRect()) => chart.dispatchEvent(new MouseEvent("
        "'click', {clientX: box.left + box.width / 2})))(document.querySelector('#curve img'))"
    )
    page.idle()
    assert 140 < float(page.read("document.querySelector('#pose-azimuth').value")) < 180
    page.click("#fit-start")
    page.until("!document.querySelector('#fit-result').hidden")
    page.idle()
    assert page.read("document.querySelector('#overlay').naturalWidth") == 224
    assert "confidence" in page.text("#fit-said")
    assert 20 < float(page.read("document.querySelector('#pose-azimuth').value")) < 50
    page.click("#pose-download")
    wait_for_file(folder / "downloads", ".json")
    assert "sample_chairs()['wooden-0']" in page.text("#fit-snippets")
    assert "focal=400.0, principal_point=(110.5, 113.0)" in page.text("#fit-snippets")
    azimuth, there = page.read("document.querySelector('#pose-azimuth').value"), page.read("location.hash")
    assert "pose=" in there
    page.open(there)  # a reload returns to it
    page.until("document.querySelector('#scene').dataset.n > 0")
    page.idle()
    assert page.read("document.querySelector('#pose-azimuth').value") == azimuth
    assert page.read("document.querySelector('#principal-x').value") == "110.5"


@pytest.mark.slow
@in_a_browser
def test_the_file_of_a_camera(page: Page, folder: Path) -> None:
    """Its numbers are written into the fields, or a sentence says why not; they stay in the address."""
    page.open("#/fit?photo=scene-chair")
    page.idle()
    camera, chooser = folder / "cameras.txt", page.driver.find_element("id", "camera-file")
    page.read("document.querySelector('#calibrated').open = true")
    camera.write_text("1 OPENCV 224 224 320 300 100 120 -0.2 0.05 0 0")
    chooser.send_keys(str(camera))
    page.until("document.querySelector('#intrinsics').value")
    page.idle()
    assert page.read("document.querySelector('#intrinsics').value") == "320, 300, 100, 120"
    assert page.read("document.querySelector('#focal').disabled")
    page.open(page.read("location.hash"))
    page.idle()
    assert page.read("document.querySelector('#distortion').value") == "-0.2, 0.05, 0, 0, 0"
    labels = "“Focal length” or “Intrinsics”"
    for intrinsics, words in (("320, 300, 100", "fx, fy, cx, cy"), ("", labels)):
        page.enter("#intrinsics", intrinsics)
        page.click("#fit-open")
        page.until(f"document.querySelector('#alert').textContent.includes('{words}')")


@pytest.mark.slow
@in_a_browser
def test_a_phone_begins_with_the_photograph(address: str, tmp_path: Path) -> None:
    """What is chosen from is folded above the view, and folds again after a choice; so begins what starts the work."""
    folded = "!document.querySelector('#choose').open"
    with browsing(tmp_path, 390, 844) as driver:
        page = Page(driver, address)
        for view, first, start in (
            ("see", "#picture", "#picture"),
            ("invert", "#invert-start", "#invert-start"),
            ("fit", "#box-canvas", "#fit-open"),
        ):
            page.open(f"#/{view}")
            page.idle()
            assert page.read(folded)
            assert page.read(f"document.querySelector('{first}').getBoundingClientRect().top < innerHeight * 2 / 3")
            assert page.read(f"document.querySelector('{start}').getBoundingClientRect().top < innerHeight")
        page.read("document.querySelector('#choose > summary').click()")
        page.click("#samples button:nth-child(2)")
        page.until(folded)
        assert page.read("document.activeElement.localName") in ("summary", "body")
        page.idle()
        page.open("#/see")
        page.idle()
        np.save(tmp_path / "mine.npy", feature.hog(data.camera()[:128, :128], feature_vector=False))
        page.driver.find_element("id", "file").send_keys(str(tmp_path / "mine.npy"))
        page.until("document.querySelector('#shape').textContent.includes('skimage')")
        assert page.read(folded)
        assert "assumed" in page.text("#decided")
        assert page.read("document.querySelector('#decided').checkVisibility()")


@in_a_browser
@pytest.mark.skipif(not AXE.exists(), reason="axe-core is not installed: npm install in tests/app/js")
@pytest.mark.parametrize(("width", "dark"), [(1280, False), (390, True)], ids=["wide-light", "narrow-dark"])
def test_accessible(address: str, tmp_path: Path, width: int, dark: bool) -> None:
    """No violation of WCAG 2.1 A and AA that axe finds in a view, contrast included, and nothing is cut off."""
    with browsing(tmp_path, width, 844, dark) as driver:
        page = Page(driver, address)
        for view in ("see", "invert", "fit"):
            page.open(f"#/{view}?photo=scene-chair&preset=paper&mesh=chair-wooden-0&size=64")
            page.idle()
            driver.execute_script(AXE.read_text(encoding="utf-8"))
            found = driver.execute_async_script(
                "const done = arguments[arguments.length - 1];"
                "axe.run({runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa']}).then(done);"
            )
            wrong = [(each["id"], [node["html"] for node in each["nodes"]]) for each in found["violations"]]
            assert wrong == [], view
            assert page.read("document.documentElement.scrollWidth") <= width, view


@pytest.mark.skipif(not TSC.exists(), reason="TypeScript is not installed: npm install in tests/app/js")
def test_types_of_the_scripts() -> None:
    node = shutil.which("node")
    assert node is not None
    command = [str(TSC), "--project", str(JS / "tsconfig.json")]
    checked = subprocess.run(command, capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout


def test_the_page_is_small_and_names_no_other_host() -> None:
    files = sorted((Path(__file__).parents[2] / "src/nablahog/app/static").iterdir())
    assert sum(file.stat().st_size for file in files) <= 250_000
    for file in files:
        text = file.read_text(encoding="utf-8").replace("http://www.w3.org/", "")  # the names of SVG's elements
        assert "http://" not in text, file.name
        assert "https://" not in text, file.name
