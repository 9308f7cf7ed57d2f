"""Who looks on while a pose is searched sees each pose that the search comes to, and can end it."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from nablahog import Camera, estimate_pose, render
from nablahog.pose.options import Ascent, SearchMethod

from ..chairs import chair

BOX = (28, 12, 95, 125)


def photograph() -> Tensor:
    camera = Camera.from_field_of_view(30, 128, 128)
    return render(chair(3), torch.tensor([[30.0, 20, 2, 0, 0, 0]]), camera)[0]


@pytest.mark.parametrize(
    ("method", "ascent"), [("best", "quadratic"), ("best", "momentum"), ("paper-edges", "momentum")]
)
def test_the_search_is_seen(method: SearchMethod, ascent: Ascent) -> None:
    seen: list[tuple[str, Tensor]] = []
    options = {"box": BOX, "initial": (0, 20), "method": method, "ascent": ascent}
    models = {"chair": chair(3)}
    watched = estimate_pose(photograph(), models, watch=lambda *each: seen.append(each), **options)  # type: ignore[arg-type]
    alone = estimate_pose(photograph(), models, **options)  # type: ignore[arg-type]
    assert torch.equal(watched.crop_pose, alone.crop_pose)
    assert {model for model, _ in seen} == {"chair"}
    assert all(pose.shape == (6,) for _, pose in seen)
    nearest = min(float((pose - watched.crop_pose).abs().max()) for _, pose in seen)
    assert nearest < 0.5  # degrees, or pixels


def test_an_exception_ends_the_search() -> None:
    class Enough(Exception):
        pass

    def watch(model: str, pose: Tensor) -> None:
        raise Enough

    with pytest.raises(Enough):
        estimate_pose(photograph(), chair(3), box=BOX, initial=(0, 20), watch=watch)
