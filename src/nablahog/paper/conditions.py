"""Objects that are harder than those of Table 2, by name: rough, cut-off and no boxes, other viewpoints and looks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from ..hog.box import Box
from ..io.images import Picture
from ..render import Mesh
from .scenes import Scene, SceneSettings, scene

Generator: TypeAlias = np.random.Generator
Floats: TypeAlias = NDArray[np.float64]

LANDSCAPE = 480  # rows of a photograph that is 640 pixels wide
_EXACT = SceneSettings(box_jitter=0)
_WIDE = replace(_EXACT, size=640, height=(100.0, 300.0))
_SHADOW, _GLOSS, _JPEG = 0.9, 0.6, (20.0, 50.0)


@dataclass(frozen=True, eq=False)
class Case:
    """What a search is given of an object.

    Attributes:
        image: (C, H, W), in 0…1.
        box: of the object; None if unknown.
        initial: azimuth and elevation, degrees; None if unknown.

    >>> from nablahog.paper import conditions
    >>> case = conditions.Case(torch.rand(3, 120, 160), nablahog.hog.box.Box(20, 10, 120, 110), initial=(0.0, 15.0))
    >>> rough = conditions.CONDITIONS["larger-20"].case(case, seed=0, index=0)
    >>> tuple(map(float, rough.box))
    (10.0, 0.0, 130.0, 120.0)
    """

    image: Tensor
    box: Box | None
    initial: tuple[float, float] | None


Change: TypeAlias = Callable[[Case, Generator], Case]


def _unchanged(case: Case, generator: Generator) -> Case:
    return case


@dataclass(frozen=True)
class Condition:
    """A kind of object.

    Attributes:
        about: what is hard about it, a sentence.
        change: of what the search is given.
        viewpoint: makes another viewpoint of azimuth, elevation and theta, (3,); None for the scene's own.
        given: whether the search is given an initial pose: a random azimuth, an elevation near the true one.
        settings: of the scenes.

    >>> from nablahog.paper import chairs, conditions
    >>> models, viewpoints = {"a": chairs.chair(1)}, np.array([[30.0, 15.0, 0.0]])  # azimuth, elevation, theta
    >>> case, truth = conditions.CONDITIONS["no-box"].scene(0, models, viewpoints, [torch.rand(200, 200)])
    >>> case.box, float(truth.pose[0])
    (None, 30.0)
    """

    about: str
    change: Change = _unchanged
    viewpoint: Callable[[Floats, Generator], Floats] | None = None
    given: bool = True
    settings: SceneSettings = _EXACT

    @property
    def of_photographs(self) -> bool:
        """Whether it changes what is known of an object only, so that photographs have it as well as scenes."""
        return self.viewpoint is None and self.settings is _EXACT

    def case(self, case: Case, seed: int, index: int) -> Case:
        """The object number ``index`` of a photograph, as the search is given it."""
        return self._changed(case, _generator(seed, index))

    def scene(
        self,
        index: int,
        models: Mapping[str, Mesh],
        viewpoints: Floats,
        photographs: Sequence[Picture],
        *,
        seed: int = 0,
    ) -> tuple[Case, Scene]:
        """What a search is given of a scene, and the truth; arguments and errors are those of :func:`.scenes.scene`.

        The same number has the same model, viewpoint and background in all conditions that do not change these.
        """
        generator = _generator(seed, index)
        if self.viewpoint is not None:
            viewpoints = self.viewpoint(viewpoints[generator.integers(len(viewpoints))].copy(), generator)[None]
        made = scene(index, models, viewpoints, photographs, seed=seed, settings=self.settings)
        initial = float(made.initial[0]), float(made.initial[1])
        return self._changed(Case(made.image, made.box, initial), generator), made

    def _changed(self, case: Case, generator: Generator) -> Case:
        return self.change(case if self.given else replace(case, initial=None), generator)


def _generator(seed: int, index: int) -> Generator:
    return np.random.default_rng([seed, index, 1])


def _off(share: float) -> Change:
    def change(case: Case, generator: Generator) -> Case:
        assert case.box is not None
        signs = share * generator.choice([-1, 1], 4)
        return replace(case, box=Box.of(np.array(case.box) + signs * _sides(case.box)))

    return change


def _larger(share: float) -> Change:
    def change(case: Case, generator: Generator) -> Case:
        assert case.box is not None
        more = share / 2 * np.array([-1, -1, 1, 1])
        return replace(case, box=Box.of(np.array(case.box) + more * _sides(case.box)))

    return change


def _sides(box: Box) -> Floats:
    """Width, height, width, height."""
    return np.tile([box.width, box.height], 2)


def _cut(share: float, *, photograph: bool) -> Change:
    def change(case: Case, generator: Generator) -> Case:
        assert case.box is not None
        side = int(generator.integers(4))
        sides = np.array(case.box)
        sides[side] += share * _sides(case.box)[side] * (1 if side < 2 else -1)
        box = Box.of(sides)
        if not photograph:
            return replace(case, box=box)
        height, width = case.image.shape[1:]
        border = [0, 0, width, height]
        border[side] = round(sides[side])
        image = case.image[:, border[1] : border[3], border[0] : border[2]]
        return replace(case, image=image, box=Box.of(np.array(box) - np.tile(border[:2], 2)))

    return change


def _no_box(case: Case, generator: Generator) -> Case:
    return replace(case, box=None)


def _landscape(case: Case, generator: Generator) -> Case:
    """640x480 pixels of a square photograph, with all of the object, and no box."""
    assert case.box is not None
    low, high = max(0, int(case.box.y1) + 1 - LANDSCAPE), min(int(case.box.y0), case.image.shape[1] - LANDSCAPE)
    top = int(generator.integers(low, high + 1))
    return replace(case, image=case.image[:, top : top + LANDSCAPE], box=None)


def _tilted(viewpoint: Floats, generator: Generator) -> Floats:
    viewpoint[2] = generator.choice([-1, 1]) * generator.uniform(12, 45)
    return viewpoint


def _steep(viewpoint: Floats, generator: Generator) -> Floats:
    viewpoint[1] = generator.uniform(-20, 75)
    return viewpoint


_NOTHING = "no initial pose is given"
_BORDER = "is the border of the photograph, which ends so far inside the object"

CONDITIONS: Mapping[str, Condition] = {
    "as-table2": Condition("The scenes of the table itself, with slightly jittered boxes.", settings=SceneSettings()),
    "exact": Condition("The box is exact."),
    "exact-no-pose": Condition(f"The box is exact; {_NOTHING}.", given=False),
    "sides-5": Condition("Each side of the box is 5 % of its width or height off, inwards or outwards.", _off(0.05)),
    "sides-10": Condition("Each side of the box is 10 % of its width or height off, inwards or outwards.", _off(0.1)),
    "larger-20": Condition("The box is 20 % wider and higher.", _larger(0.2)),
    "larger-40": Condition("The box is 40 % wider and higher.", _larger(0.4)),
    "cut-15": Condition("One side of the box is 15 % too far inside.", _cut(0.15, photograph=False)),
    "cut-30": Condition("One side of the box is 30 % too far inside.", _cut(0.3, photograph=False)),
    "photograph-cut-15": Condition(f"One side of the box {_BORDER}: 15 %.", _cut(0.15, photograph=True)),
    "photograph-cut-30": Condition(f"One side of the box {_BORDER}: 30 %.", _cut(0.3, photograph=True)),
    "no-box": Condition("There is no box; methods without a search for it take the whole photograph.", _no_box),
    "no-box-no-pose": Condition(f"There is no box, and {_NOTHING}.", _no_box, given=False),
    "landscape": Condition("There is no box, in 640x480 pixels.", _landscape, settings=_WIDE),
    "landscape-no-pose": Condition(
        f"There is no box, in 640x480 pixels, and {_NOTHING}.", _landscape, given=False, settings=_WIDE
    ),
    "tilted": Condition(f"In-plane rotations of 12 to 45°; {_NOTHING}.", viewpoint=_tilted, given=False),
    "steep": Condition(
        f"Elevations of −20 to 75°: higher up, azimuth and in-plane rotation are one; {_NOTHING}.",
        viewpoint=_steep,
        given=False,
    ),
    "sides-10-tilted": Condition(
        f"Each side of the box is 10 % off, and in-plane rotations are 12 to 45°; {_NOTHING}.",
        _off(0.1),
        _tilted,
        False,
    ),
    "shadows": Condition(
        "The object casts shadows on itself and on the floor.", settings=replace(_EXACT, shadow=_SHADOW)
    ),
    "highlights": Condition("The object is glossy.", settings=replace(_EXACT, gloss=_GLOSS)),
    "jpeg": Condition("The image is compressed as JPEG of quality 20 to 50.", settings=replace(_EXACT, jpeg=_JPEG)),
    "renderer": Condition(
        "The look of another renderer: cast shadows, highlights, and JPEG of quality 20 to 50.",
        settings=replace(_EXACT, shadow=_SHADOW, gloss=_GLOSS, jpeg=_JPEG),
    ),
}
"""All conditions by name; a new one is one more entry, and its name in :mod:`nablahog.paper.names`."""
