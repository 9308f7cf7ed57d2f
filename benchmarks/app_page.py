"""How fast the page of `nablahog app` answers, in a real browser, and what it weighs.

    python benchmarks/app_page.py [--repeats 15] [--screenshots FOLDER]

Times are taken in the browser, from the event to the frame that shows its result; median and range, warm.  Needs
Chromium with its driver.  With ``--screenshots``, each view is pictured at 1280 and 390 pixels, light and dark.
"""

from __future__ import annotations

import argparse
import re
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.app.browser import Page, browsing, serving

STATIC = Path(__file__).parent.parent / "src" / "nablahog" / "app" / "static"
# calls `done` with the milliseconds from `trigger` to the frame in which an attribute of an element has changed
TIMED = """
const done = arguments[arguments.length - 1], [selector, attribute, trigger, value] = arguments;
const element = document.querySelector(selector), before = element.getAttribute(attribute);
const run = new Function("value", trigger);
Promise.resolve(run.prepare).then(async () => {
  const prepared = value === "photograph" ? await photograph() : value;
  const began = performance.now();
  new MutationObserver((_, observer) => {
    if (element.getAttribute(attribute) === before) return;
    observer.disconnect();
    requestAnimationFrame(() => done(performance.now() - began));
  }).observe(element, {attributes: true});
  run(prepared);
});
async function photograph() {
  const side = 512, canvas = new OffscreenCanvas(side, side), context = canvas.getContext("2d");
  for (let k = 0; k < 400; k++) {
    context.fillStyle = `hsl(${Math.random() * 360} 60% ${Math.random() * 100}%)`;
    context.fillRect(Math.random() * side, Math.random() * side, Math.random() * 90, Math.random() * 90);
  }
  return new File([await canvas.convertToBlob({type: "image/png"})], "drawn.png", {type: "image/png"});
}
"""
DROP = """
const data = new DataTransfer();
data.items.add(value);
document.body.dispatchEvent(new DragEvent("drop", {bubbles: true, cancelable: true, dataTransfer: data}));
"""
ENTER = """
const control = document.querySelector("#controls [name=cell_size]");
control.value = value;
for (const kind of ["input", "change"]) control.dispatchEvent(new Event(kind, {bubbles: true}));
"""
DRAG = """
const scene = document.querySelector("#scene"), box = scene.getBoundingClientRect();
const pointer = {bubbles: true, pointerId: 1, isPrimary: true, button: 0, buttons: 1, clientY: box.y + 90};
const at = (x) => ({...pointer, clientX: box.x + x});
scene.dispatchEvent(new PointerEvent("pointerdown", at(100)));
scene.dispatchEvent(new PointerEvent("pointermove", at(100 + value)));
scene.dispatchEvent(new PointerEvent("pointerup", at(100 + value)));
"""
# calls `done` with the milliseconds from a click on Start to each frame, and to the end
FRAMES = """
const done = arguments[arguments.length - 1], canvas = document.querySelector("#preimage"), times = [];
const began = performance.now();
new MutationObserver((_, observer) => {
  if (canvas.dataset.frames !== "0") times.push(performance.now() - began);
  if (canvas.dataset.state !== "running") { observer.disconnect(); done(times); }
}).observe(canvas, {attributes: true, attributeFilter: ["data-frames", "data-state"]});
document.querySelector("#invert-start").click();
"""


def timed(page: Page, selector: str, attribute: str, trigger: str, values: list[object]) -> list[float]:
    """Milliseconds of each value, but the first, which warms up."""
    taken = []
    for value in values:
        page.driver.set_script_timeout(60)
        taken.append(page.driver.execute_async_script(TIMED, selector, attribute, trigger, value))
        page.idle()
    return taken[1:]


def said(name: str, values: list[float], unit: str, goal: str) -> None:
    print(
        f"| {name} | {statistics.median(values):.0f} ({min(values):.0f}–{max(values):.0f}) {unit} | {goal} |",
        flush=True,
    )


def of_extra() -> tuple[list[str], float]:
    """The packages that the extra `app` adds, and their megabytes."""
    base, more = closure("nablahog", ""), closure("nablahog", "app")
    added = sorted(more - base)
    files = [Path(str(file.locate())) for name in added for file in metadata.files(name) or []]
    sizes = [file.stat().st_size for file in files if file.exists()]
    return added, sum(sizes) / 1e6


def closure(name: str, extra: str) -> set[str]:
    """A package and all that it requires."""
    found: set[str] = set()
    waiting = [(name, extra)]
    while waiting:
        name, extra = waiting.pop()
        normal = re.sub(r"[-_.]+", "-", name).lower()
        if normal in found and not extra:
            continue
        found.add(normal)
        for text in metadata.requires(name) or []:
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
                waiting += [(requirement.name, each) for each in requirement.extras or [""]]
    return found


def seconds_to_first_page() -> float:
    """From the command to the first page."""
    began = time.monotonic()
    command = [sys.executable, "-m", "nablahog", "app", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        match = re.search(r"http://\S+", process.stdout.readline())
        assert match is not None
        urllib.request.urlopen(match[0]).read()
        taken = time.monotonic() - began
        process.terminate()
    return taken


def measure(page: Page, repeats: int) -> None:
    print("| | median (range) | goal |\n|---|---:|---:|")
    page.open("#/see?photo=sample-astronaut&preset=uoctti&size=512")
    page.idle()
    said(
        "drop of a 512² photograph to glyphs",
        timed(page, "#glyphs", "data-key", DROP, ["photograph"] * repeats),
        "ms",
        "100",
    )
    cells: list[object] = [6 + k % 9 for k in range(repeats)]
    said("slider to new glyphs", timed(page, "#glyphs", "data-key", ENTER, cells), "ms", "50")
    page.open("#/invert?photo=sample-astronaut&preset=uoctti&size=256&method=prior")
    page.idle()
    first, rates = [], []
    for _ in range(min(repeats, 5)):
        times = page.driver.execute_async_script(FRAMES)
        page.idle()
        first.append(times[0])
        rates.append((len(times) - 2) / (times[-2] - times[0]) * 1000)
    said("first frame of a pre-image, 256²", first[1:], "ms", "300")
    said("frames a second", rates[1:], "", "≥ 10")
    page.open("#/fit?photo=scene-chair&mesh=chair-3")
    page.click("#fit-open")
    page.until("document.querySelector('#scene').dataset.n > 0")
    page.idle()
    drags: list[object] = [(-1) ** k * (10 + k) for k in range(repeats)]
    said("drag to rendering and similarity", timed(page, "#scene", "data-n", DRAG, drags), "ms", "40")


def pictures(address: str, folder: Path) -> Iterator[Path]:
    """Each view, at two widths, light and dark."""
    for width, dark in ((1280, False), (1280, True), (390, False), (390, True)):
        with tempfile.TemporaryDirectory() as profile, browsing(Path(profile), width, 844, dark) as driver:
            page = Page(driver, address)
            page.open("#/see?photo=sample-chelsea&preset=uoctti&size=256")
            page.idle()
            page.press("#glyphs", "ArrowRight")
            page.idle()
            yield picture(page, folder, f"see-{width}", dark)
            page.open("#/invert?photo=sample-astronaut&preset=skimage&size=256")
            page.click("#invert-start")
            page.until("document.querySelector('#preimage').dataset.state === 'done'")
            page.idle()
            yield picture(page, folder, f"invert-{width}", dark)
            page.open("#/fit?photo=scene-chair&mesh=chair-3")
            page.click("#fit-open")
            page.until("document.querySelector('#scene').dataset.n > 0")
            page.idle()
            page.click("#fit-start")
            page.until("!document.querySelector('#fit-result').hidden")
            page.idle()
            yield picture(page, folder, f"fit-{width}", dark)


def picture(page: Page, folder: Path, name: str, dark: bool) -> Path:
    path = folder / f"{name}-{'dark' if dark else 'light'}.png"
    height = page.read("document.documentElement.scrollHeight")
    width = page.read("innerWidth")
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    page.driver.save_screenshot(str(path))
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {**metrics, "height": 844})
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--screenshots", type=Path)
    options = parser.parse_args()
    with serving() as address:
        if options.screenshots is not None:
            options.screenshots.mkdir(parents=True, exist_ok=True)
            for path in pictures(address, options.screenshots):
                print(path)
            return
        with tempfile.TemporaryDirectory() as profile, browsing(Path(profile)) as driver:
            measure(Page(driver, address), options.repeats)
    said("start to first page", [seconds_to_first_page() for _ in range(4)][1:], "s", "3")
    size = sum(file.stat().st_size for file in STATIC.iterdir())
    names, megabytes = of_extra()
    print(f"| bytes of the page | {size:,} | 250,000 |")
    print(f"| packages of the extra | {len(names)}, {megabytes:.1f} MB: {', '.join(names)} | 15 MB |")


if __name__ == "__main__":
    main()
