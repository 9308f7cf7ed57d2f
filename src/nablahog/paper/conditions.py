"""Objects that are harder than those of Table 2, by name: rough, cut-off and no boxes, other viewpoints and looks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..hog.box import Box
from ..io.images import Picture
from ..render import Mesh
from .annotations import AnnotatedObject
from .scenes import SceneSettings, scene

Generator: TypeAlias = np.random.Generator
Floats: TypeAlias = NDArray[np.float64]

_EXACT = SceneSettings(box_jitter=0)
_SHADOW, _GLOSS, _JPEG = 0.9, 0.6, (20.0, 50.0)

Change: TypeAlias = Callable[[AnnotatedObject, Generator], AnnotatedObject]


def _unchanged(one: AnnotatedObject, generator: Generator) -> AnnotatedObject:
    return one


@dataclass(frozen=True)
class Condition:
    """What makes objects harder.

    Attributes:
        about: what is hard, a sentence.
        change: to the box or the initial pose.
        viewpoint: makes another viewpoint of azimuth, elevation and theta, (3,); None for the scene's own.
        has_initial: whether a search gets an initial pose.
        settings: of the scenes.

    >>> from nablahog.hog.box import Box
    >>> from nablahog.paper.annotations import AnnotatedObject
    >>> from nablahog.paper.conditions import CONDITIONS
    >>> one = AnnotatedObject("a", torch.rand(3, 120, 160), Box(20, 10, 120, 110), 30.0, 15.0, 0.0, None)
    >>> tuple(map(float, CONDITIONS["larger-20"].applied(one, seed=0, index=0).box))
    (10.0, 0.0, 130.0, 120.0)
    """

    about: str
    change: Change = _unchanged
    viewpoint: Callable[[Floats, Generator], Floats] | None = None
    has_initial: bool = True
    settings: SceneSettings = _EXACT

    @property
    def of_photographs(self) -> bool:
        """Whether only the box or the initial pose changes, so that photographs have it as well as scenes."""
        return self.viewpoint is None and self.settings is _EXACT

    def applied(self, one: AnnotatedObject, seed: int, index: int) -> AnnotatedObject:
        """The object number ``index`` under this condition."""
        return self._changed(one, _generator(seed, index))

    def scene(
        self,
        index: int,
        models: Mapping[str, Mesh],
        viewpoints: Floats,
        photographs: Sequence[Picture],
        *,
        seed: int = 0,
    ) -> AnnotatedObject:
        """The scene number ``index`` under this condition; arguments and errors are those of :func:`.scenes.scene`.

        The same number has the same model, viewpoint and background in all conditions that do not change these.
        """
        generator = _generator(seed, index)
        if self.viewpoint is not None:
            viewpoints = self.viewpoint(viewpoints[generator.integers(len(viewpoints))].copy(), generator)[None]
        made = scene(index, models, viewpoints, photographs, seed=seed, settings=self.settings)
        return self._changed(made.annotated(f"{index:04d}"), generator)

    def _changed(self, one: AnnotatedObject, generator: Generator) -> AnnotatedObject:
        return self.change(one if self.has_initial else replace(one, initial=None), generator)


def _generator(seed: int, index: int) -> Generator:
    return np.random.default_rng([seed, index, 1])


def _off(share: float) -> Change:
    def change(one: AnnotatedObject, generator: Generator) -> AnnotatedObject:
        assert one.box is not None
        signs = share * generator.choice([-1, 1], 4)
        return replace(one, box=Box.of(np.array(one.box) + signs * _sides(one.box)))

    return change


def _larger(share: float) -> Change:
    def change(one: AnnotatedObject, generator: Generator) -> AnnotatedObject:
        assert one.box is not None
        more = share / 2 * np.array([-1, -1, 1, 1])
        return replace(one, box=Box.of(np.array(one.box) + more * _sides(one.box)))

    return change


def _sides(box: Box) -> Floats:
    """Width, height, width, height."""
    return np.tile([box.width, box.height], 2)


def _cut(share: float) -> Change:
    def change(one: AnnotatedObject, generator: Generator) -> AnnotatedObject:
        assert one.box is not None
        side = int(generator.integers(4))
        sides = np.array(one.box)
        sides[side] += share * _sides(one.box)[side] * (1 if side < 2 else -1)
        return replace(one, box=Box.of(sides))

    return change


def _no_box(one: AnnotatedObject, generator: Generator) -> AnnotatedObject:
    return replace(one, box=None)


def _tilted(viewpoint: Floats, generator: Generator) -> Floats:
    viewpoint[2] = generator.choice([-1, 1]) * generator.uniform(12, 45)
    return viewpoint


def _steep(viewpoint: Floats, generator: Generator) -> Floats:
    viewpoint[1] = generator.uniform(-20, 75)
    return viewpoint


CONDITIONS: Mapping[str, Condition] = {
    "exact": Condition("The box is exact."),
    "sides-5": Condition("Each side of the box is 5 % of its width or height off, inwards or outwards.", _off(0.05)),
    "sides-10": Condition("Each side of the box is 10 % of its width or height off, inwards or outwards.", _off(0.1)),
    "larger-20": Condition("The box is 20 % wider and higher.", _larger(0.2)),
    "cut-15": Condition("One side of the box is 15 % too far inside.", _cut(0.15)),
    "cut-30": Condition("One side of the box is 30 % too far inside.", _cut(0.3)),
    "no-box": Condition("There is no box; methods without a search for it take the whole photograph.", _no_box),
    "tilted": Condition(
        "In-plane rotations of 12 to 45°; no initial pose is given.", viewpoint=_tilted, has_initial=False
    ),
    "steep": Condition(
        "Elevations of −20 to 75°: higher up, azimuth and in-plane rotation are one; no initial pose is given.",
        viewpoint=_steep,
        has_initial=False,
    ),
    "renderer": Condition(
        "The look of another renderer: cast shadows, highlights, and JPEG of quality 20 to 50.",
        settings=replace(_EXACT, shadow=_SHADOW, gloss=_GLOSS, jpeg=_JPEG),
    ),
}
"""All conditions by name; a new one is one more entry, and its name in :mod:`nablahog.paper.names`."""

PLAIN = Condition("The scenes of the table itself, with slightly jittered boxes.", settings=SceneSettings())
