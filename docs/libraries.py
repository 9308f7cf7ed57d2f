"""Makes docs/libraries.png: photographs that scikit-image installs, each from what every library's HOG says of it.

`python docs/libraries.py`; five minutes.  The photographs are in the public domain or under CC0.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from nablahog import metrics
from nablahog.evaluate.methods import METHODS, Table1Settings
from nablahog.evaluate.names import DIALECTS
from nablahog.evaluate.photographs import sample_photographs
from nablahog.viz.pictures import Panel, contact_sheet

HERE = Path(__file__).parent
SIZE = 128
NAMES = ("astronaut", "camera", "chelsea", "coffee")


def row(name: str, image: Tensor) -> list[Panel]:
    """The photograph, and what is found from each library's descriptor of it."""
    panels = [Panel(image, name)]
    for dialect in DIALECTS:
        result = METHODS[dialect].run(image[None, None], Table1Settings())[0].image.clamp(0, 1)
        panels.append(Panel(result, f"{metrics.cross_correlation(result, image):.2f} {dialect}"))
    return panels


def main() -> None:
    squares = sample_photographs(size=SIZE).images
    rows = []
    for name in NAMES:
        print(f"inverting {name}")
        panels = row(name, squares[name])
        half = (len(panels) + 1) // 2
        rows += [panels[:half], panels[half:]]
    sheet = contact_sheet(rows, height=SIZE)
    # 64 gray levels do, and keep the file below a megabyte
    sheet.convert("L").quantize(64).save(HERE / "libraries.png", optimize=True)


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
