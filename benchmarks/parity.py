"""How far the operator is from each library's own HOG, on every stored output of theirs, as a Markdown table.

In the layout and the precision of the library, bytes as input; see ``tests/golden/README.md`` for what is stored.
"""

from __future__ import annotations

import sys
from pathlib import Path

import torch

from nablahog.hog import hog

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.golden import PEERS, Case, archive, cases


def difference(case: Case) -> torch.Tensor:
    """The operator's entries less the library's, in one row, float64."""
    torch.set_default_dtype(case.dtype)
    result = hog(case.image, case.spec, layout="native")[0]
    torch.set_default_dtype(torch.float32)
    return (result.double() - case.stored.double()).flatten()


def main() -> None:
    """Print the table."""
    print("| library | version | outputs | entries | largest difference | root mean square |")
    print("|---|---|---|---|---|---|")
    for peer in PEERS:
        differences = [difference(case) for case in cases(peer)]
        every = torch.cat(differences)
        largest, rms = float(every.abs().max()), float(every.square().mean().sqrt())
        version = str(archive(peer)["version"]).split(",")[0]
        print(f"| {peer} | {version} | {len(differences)} | {len(every):,} | {largest:.1e} | {rms:.1e} |")


if __name__ == "__main__":
    main()
