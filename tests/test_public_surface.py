"""The public names, kinds and signatures are those of tests/public_surface.json.

After an intended change of the public surface, `make generated` writes the file anew; check its difference, and say in
CHANGELOG.md what has changed.
"""

from __future__ import annotations

import json
from pathlib import Path

from tests.public_surface import surface

STORED = Path(__file__).with_name("public_surface.json")


def test_the_public_surface_is_the_stored_one() -> None:
    stored, present = json.loads(STORED.read_text()), surface()
    changed = sorted(name for name in {*stored, *present} if stored.get(name) != present.get(name))
    assert stored == present, (
        f"the public surface has changed in {', '.join(changed)}: if that is meant, run `make generated` "
        "and say so in CHANGELOG.md"
    )
