"""Cases that found a fault, kept as seeds: ``TARGET.json`` for a target whose cases are tuples."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from nablahog.hog import HOGSpec


def stored_cases(target: str, kind: Any) -> list[Any]:
    """The cases of a target, of the named tuple ``kind``."""
    stored = json.loads((Path(__file__).parent / f"{target}.json").read_text())
    return [
        kind(**{**case, "spec": HOGSpec.from_json(json.dumps(case["spec"])), "shape": tuple(case["shape"])})
        for case in stored
    ]
