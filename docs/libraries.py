"""Makes docs/libraries.png: photographs that scikit-image installs, each from what every library's HOG says of it; and
docs/libraries-learned.png, the same with the priors that come with the package.

`python docs/libraries.py`; ten minutes.  The photographs are in the public domain or under CC0.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from nablahog import metrics
from nablahog.io.photographs import sample_photographs
from nablahog.paper.learned import shipped_files
from nablahog.paper.methods import METHODS, Table1Settings
from nablahog.paper.names import DIALECTS, LEARNED_DIALECTS
from nablahog.viz.pictures import Panel, contact_sheet

HERE = Path(__file__).parent
SIZE = 128
NAMES = ("astronaut", "camera", "chelsea", "coffee")
SHEETS = {"libraries.png": tuple(DIALECTS), "libraries-learned.png": LEARNED_DIALECTS}


def row(name: str, image: Tensor, methods: Sequence[str]) -> list[Panel]:
    """The photograph, and what is found from each library's descriptor of it."""
    panels, settings = [Panel(image, name)], Table1Settings(learned=shipped_files())
    for method in methods:
        result = METHODS[method].run(image[None, None], settings)[0].image.clamp(0, 1)
        likeness = metrics.cross_correlation(result, image)
        panels.append(Panel(result, f"{likeness:.2f} {method.removesuffix('-learned')}"))
    return panels


def main() -> None:
    squares = sample_photographs(size=SIZE).images
    for file, methods in SHEETS.items():
        rows = []
        for name in NAMES:
            print(f"inverting {name} for {file}")
            panels = row(name, squares[name], methods)
            half = (len(panels) + 1) // 2
            rows += [panels[:half], panels[half:]]
        sheet = contact_sheet(rows, height=SIZE)
        # 64 gray levels do, and keep the file below a megabyte
        sheet.convert("L").quantize(64).save(HERE / file, optimize=True)


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
