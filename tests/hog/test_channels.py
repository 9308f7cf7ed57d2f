"""What channels are."""

from __future__ import annotations

import pytest

from nablahog.hog import presets
from nablahog.hog.layout import channel_names


@pytest.mark.parametrize("name", presets.__all__)
def test_each_channel_has_a_name_of_its_own(name: str) -> None:
    spec = presets.BY_NAME[name]
    names = channel_names(name)
    assert len(names) == len({*names}) == spec.channels


def test_names_say_what_a_channel_is() -> None:
    assert channel_names("paper")[:2] == ("10°", "30°")
    assert channel_names("opencv")[-1] == "cell 1, 1 of the block: 170°"
    assert channel_names("dpm")[27:] == (
        *(f"texture: block {block}" for block in ("down-right", "up-right", "down-left", "up-left")),
        "always 0",
    )
    assert channel_names("maskfeat")[9] == "green, 80°"
