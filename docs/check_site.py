"""Checks that every link inside the built site leads somewhere, that no page loads anything from elsewhere, and that
each script of the gallery and the tutorials has drawn pictures with something on them.

python -m docs.check_site build/docs/html
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from PIL import Image

LOADED = {"img": "src", "script": "src", "source": "src", "video": "src", "audio": "src", "iframe": "src"}
LOADED_BY_LINK = {"stylesheet", "preload", "modulepreload", "icon", "preconnect", "dns-prefetch"}


class Page(HTMLParser):
    """What a page refers to, what it loads, and its anchors."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        of = {name: value or "" for name, value in attrs}
        self.anchors.update(of[name] for name in ("id", "name") if name in of)
        if tag == "a" and "href" in of:
            self.links.append(of["href"])
        if tag == "link" and "href" in of and LOADED_BY_LINK & set(of.get("rel", "").split()):
            self.loads.append(of["href"])
        if of.get(LOADED.get(tag, "")):
            self.loads.append(of[LOADED[tag]])


@cache
def page(path: Path) -> Page:
    """A page of the site, parsed."""
    parsed = Page()
    parsed.feed(path.read_text(encoding="utf-8"))
    return parsed


def dead(site: Path, path: Path) -> Iterator[str]:
    """What is wrong with the links of one page."""
    name = path.relative_to(site)
    for load in page(path).loads:
        if urlsplit(load).netloc:
            yield f"{name} loads {load}"
    for link in page(path).links + page(path).loads:
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
        target = target / "index.html" if target.is_dir() else target
        if not target.is_relative_to(site) or not target.is_file():
            yield f"{name}: no file {link}"
        elif parts.fragment and target.suffix == ".html" and unquote(parts.fragment) not in page(target).anchors:
            yield f"{name}: no place {link}"


def blank(site: Path, path: Path) -> Iterator[str]:
    """What is wrong with the pictures that a script has drawn on its page."""
    drawn = [load for load in page(path).loads if "/sphx_glr_" in load and not load.endswith("_thumb.png")]
    if path.name.startswith("plot_") and not drawn:
        yield f"{path.relative_to(site)}: no picture"
    for load in drawn:
        with Image.open(path.parent / unquote(load)) as picture:
            if not any(high - low > 100 for low, high in picture.convert("RGB").getextrema()):
                yield f"{path.relative_to(site)}: nothing on {load}"


def main() -> int:
    """Prints dead links and empty pictures; the exit status is 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("site", type=Path, help="folder of the built site")
    site = parser.parse_args().site.resolve()
    pages = sorted(
        path for path in site.rglob("*.html") if "_static" not in path.parts
    )  # there: templates of the theme
    wrong = sorted({line for path in pages for line in dead(site, path)})
    empty = sorted({line for path in pages for line in blank(site, path)})
    print(*wrong, *empty, sep="\n", end="\n" if wrong or empty else "")
    links = sum(len(page(path).links) for path in pages)
    print(f"{len(pages)} pages, {links} links, {len(wrong)} dead, {len(empty)} pictures missing or empty")
    return 1 if wrong or empty or not pages else 0


if __name__ == "__main__":
    sys.exit(main())
