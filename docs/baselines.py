"""Makes docs/baselines.png: eight photographs that scikit-image installs, inverted by every method of Table 1 but one.

`python docs/baselines.py`; half an hour.  The photographs are in the public domain or under CC0.  What methods learn
from photographs they learn here from four of the eight, and invert the other four; HOGgles takes 400 batches of windows
instead of 1,000.  The prior of uoctti-learned would take hours, and is left out.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from torch import Tensor

from nablahog import metrics
from nablahog.cli.terminal import counter
from nablahog.paper.baselines.bovw_learning import learn_bovw
from nablahog.paper.baselines.hoggles_learning import learn_hoggles
from nablahog.paper.learned import SPEC, tiles
from nablahog.paper.methods import METHODS, Table1Settings
from nablahog.paper.photographs import sample_photographs
from nablahog.viz.pictures import Panel, contact_sheet

HERE = Path(__file__).parent
SIZE = 128
LEFT_OUT = "uoctti-learned"


def learned_from(images: dict[str, Tensor], folder: Path) -> dict[str, Path]:
    """Files of all that the methods need."""
    kinds: dict[str, Any] = {
        "bovw": learn_bovw(tiles(images, SIZE)),
        "hoggles": learn_hoggles(images, SPEC, iterations=400, progress=report),
    }
    files = {kind: folder / f"{kind}.npz" for kind in kinds}
    for kind, path in files.items():
        kinds[kind].save(path)
    return files


def row(name: str, image: Tensor, learned: dict[str, Path]) -> list[Panel]:
    """The photograph, and what each method finds for it."""
    panels = [Panel(image, name)]
    for method in METHODS.values():
        if method.name != LEFT_OUT and not method.asked:
            result = method.run(image[None, None], Table1Settings(learned=learned))[0].image.clamp(0, 1)
            panels.append(Panel(result, f"{metrics.cross_correlation(result, image):.2f} {method.name}"))
    return panels


def main() -> None:
    whole, squares = sample_photographs(size=512, whole=True).images, sample_photographs(size=SIZE).images
    names = list(squares)
    rows = {}
    for seen, unseen in ((names[::2], names[1::2]), (names[1::2], names[::2])):
        with TemporaryDirectory() as folder:
            learned = learned_from({name: whole[name] for name in seen}, Path(folder))
            for name in unseen:
                print(f"inverting {name}")
                rows[name] = row(name, squares[name], learned)
    sheet = contact_sheet([rows[name] for name in names], height=SIZE)
    # 64 gray levels do, and keep the file below a megabyte
    sheet.convert("L").quantize(64).save(HERE / "baselines.png", optimize=True)


if __name__ == "__main__":
    torch.set_num_threads(1)
    with counter("docs/baselines.py, learning hoggles") as report:
        main()
