"""What Table 2 is made from: objects in images, the models to choose among, and conditions that make objects harder.

The conditions are rough, cut-off and missing boxes, other viewpoints, and other looks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..inputs.boxes import Box
from ..io.images import Picture
from ..render import Mesh
from ..render.models import Model
from ..runtime.text import counted
from .annotations import Example
from .scenes import SceneSettings, scene

Generator: TypeAlias = np.random.Generator
Floats: TypeAlias = NDArray[np.float64]

_EXACT = SceneSettings(box_jitter=0)
_OUTWARDS = np.array([-1, -1, 1, 1])

Change: TypeAlias = Callable[[Example, Generator], Example]


def _keep(example: Example, generator: Generator) -> Example:
    return example


@dataclass(frozen=True)
class Condition:
    """A condition that makes objects harder.

    Attributes:
        about: what is hard, a sentence.
        change: to the box or the initial pose.
        viewpoint: makes another viewpoint of azimuth, elevation and theta, (3,); None for the scene's own.
        has_initial: whether a search gets an initial pose.
        settings: of the scenes.

    >>> from nablahog.inputs.boxes import Box
    >>> from nablahog.paper.annotations import Example
    >>> from nablahog.paper.examples import CONDITIONS
    >>> example = Example("a", torch.rand(3, 120, 160), Box(20, 10, 120, 110), 30.0, 15.0, 0.0, None)
    >>> tuple(map(float, CONDITIONS["larger-20"].apply(example, seed=0, index=0).box))
    (10.0, 0.0, 130.0, 120.0)
    """

    about: str
    change: Change = _keep
    viewpoint: Callable[[Floats, Generator], Floats] | None = None
    has_initial: bool = True
    settings: SceneSettings = _EXACT

    @property
    def of_photographs(self) -> bool:
        """Whether only the box or the initial pose changes, so that photographs have it as well as scenes."""
        return self.viewpoint is None and self.settings is _EXACT

    def apply(self, example: Example, seed: int, index: int) -> Example:
        """The object number ``index`` under this condition."""
        return self._apply_change(example, _generator(seed, index))

    def scene(
        self,
        index: int,
        models: Mapping[str, Mesh],
        viewpoints: Floats,
        photographs: Sequence[Picture],
        *,
        seed: int = 0,
    ) -> Example:
        """The scene number ``index`` under this condition; arguments and errors are those of :func:`.scenes.scene`.

        The same number has the same model, viewpoint and background in all conditions that do not change these.
        """
        generator = _generator(seed, index)
        if self.viewpoint is not None:
            viewpoints = self.viewpoint(viewpoints[generator.integers(len(viewpoints))].copy(), generator)[None]
        rendered = scene(index, models, viewpoints, photographs, seed=seed, settings=self.settings)
        return self._apply_change(rendered.annotated(f"{index:04d}"), generator)

    def _apply_change(self, example: Example, generator: Generator) -> Example:
        return self.change(example if self.has_initial else replace(example, initial=None), generator)


def _generator(seed: int, index: int) -> Generator:
    return np.random.default_rng([seed, index, 1])


def _move_sides(sides: Callable[[Generator], NDArray[np.floating]]) -> Change:
    """A change that moves the sides of a box to the right and downwards by shares of its width and height."""

    def change(example: Example, generator: Generator) -> Example:
        assert example.box is not None
        by = sides(generator) * np.tile([example.box.width, example.box.height], 2)
        return replace(example, box=Box(*(np.array(example.box) + by)))

    return change


def _shift_sides(share: float) -> Change:
    return _move_sides(lambda generator: share * generator.choice([-1, 1], 4))


def _cut_side(share: float) -> Change:
    return _move_sides(lambda generator: -share * _OUTWARDS * np.eye(4)[int(generator.integers(4))])


def _remove_box(example: Example, generator: Generator) -> Example:
    return replace(example, box=None)


def _tilt_view(viewpoint: Floats, generator: Generator) -> Floats:
    viewpoint[2] = generator.choice([-1, 1]) * generator.uniform(12, 45)
    return viewpoint


def _raise_view(viewpoint: Floats, generator: Generator) -> Floats:
    viewpoint[1] = generator.uniform(-20, 75)
    return viewpoint


CONDITIONS: Mapping[str, Condition] = {
    "exact": Condition("The box is exact."),
    "sides-5": Condition(
        "Each side of the box is 5 % of its width or height off, inwards or outwards.", _shift_sides(0.05)
    ),
    "sides-10": Condition(
        "Each side of the box is 10 % of its width or height off, inwards or outwards.", _shift_sides(0.1)
    ),
    "larger-20": Condition("The box is 20 % wider and higher.", _move_sides(lambda generator: 0.1 * _OUTWARDS)),
    "cut-15": Condition("One side of the box is 15 % too far inside.", _cut_side(0.15)),
    "cut-30": Condition("One side of the box is 30 % too far inside.", _cut_side(0.3)),
    "no-box": Condition("There is no box; methods without a search for it take the whole photograph.", _remove_box),
    "tilted": Condition(
        "In-plane rotations of 12 to 45°; no initial pose is given.", viewpoint=_tilt_view, has_initial=False
    ),
    "steep": Condition(
        "Elevations of −20 to 75°: from high up, azimuth and in-plane rotation look alike; no initial pose is given.",
        viewpoint=_raise_view,
        has_initial=False,
    ),
    "renderer": Condition(
        "The look of another renderer: cast shadows, highlights, and JPEG of quality 20 to 50.",
        settings=replace(_EXACT, shadow=0.9, gloss=0.6, jpeg=(20.0, 50.0)),
    ),
}
"""All conditions by name; a new one is one more entry, and its name in :mod:`.names`."""

PLAIN = Condition("The scenes of the table itself, with slightly jittered boxes.", settings=SceneSettings())


@dataclass
class Examples:
    """Objects to estimate the pose of; where they are from, in whole sentences; why images failed, by their names."""

    objects: list[Example]
    origin: str
    failed: Mapping[str, str] = field(default_factory=dict)


def photograph_examples(
    objects: Sequence[Example],
    models: Sequence[Model],
    *,
    origin: str,
    unknown_model: bool,
    seed: int,
    condition: str = "",
    failed: Mapping[str, str] | None = None,
) -> Examples:
    """Objects in photographs, whose candidates are all ``models``, or all but their own.

    No initial pose is given, as nothing but the box is known of a photograph.

    Args:
        objects: with the name of their own model or of the one most like them.
        models: the candidates.
        origin, failed: as :class:`Examples` has them.
        unknown_model: whether to leave an object's own model out.
        seed: of the condition.
        condition: one of :data:`CONDITIONS` that photographs can have; none if empty.

    Raises:
        ValueError: an object has no candidate.
    """
    examples = []
    for index, annotated in enumerate(objects):
        candidates = tuple(model for model in models if not (unknown_model and model.name == annotated.model))
        if not candidates:
            raise ValueError(f"{annotated.name}: there is no candidate model")
        example = replace(annotated, initial=None, candidates=candidates)
        if condition:
            example = replace(CONDITIONS[condition].apply(example, seed, index), name=f"{condition}/{example.name}")
        examples.append(example)
    among = f"{counted(len(models), 'model')}{', without its own or the one most like it' if unknown_model else ''}"
    return Examples(examples, f"{origin} Candidates for each: {among}; no pose is given.", failed or {})


class _Meshes(Mapping[str, Mesh]):
    """The meshes of models by name, each read when a scene has it."""

    def __init__(self, models: Sequence[Model]) -> None:
        self._models = {model.name: model for model in models}

    def __getitem__(self, name: str) -> Mesh:
        return self._models[name].mesh()

    def __iter__(self) -> Iterator[str]:
        return iter(self._models)

    def __len__(self) -> int:
        return len(self._models)


def render_examples(
    count: int,
    models: Sequence[Model],
    viewpoints: NDArray[np.float64],
    photographs: Sequence[Picture],
    *,
    origin: str,
    unknown_model: bool,
    seed: int,
    condition: str = "",
) -> Examples:
    """Scenes of models in front of photographs, whose candidate is their own model, or all others.

    The initial pose is that of the scene: a random azimuth, an elevation near the truth.

    Args:
        count: scenes, at least 1.
        models, viewpoints, photographs: as :func:`.scenes.scene` takes them, but models as a list.
        origin: of these: the middle of a sentence.
        unknown_model: whether to leave the scene's own model out, and search with all others.
        seed: of the scenes.
        condition: one of :data:`CONDITIONS`; none if empty.

    Raises:
        ValueError: there is no candidate.
    """
    if unknown_model and len(models) < 2:
        raise ValueError(f"an unknown model needs at least 2 models to leave one out, got {len(models)}")
    meshes, scenes = _Meshes(models), CONDITIONS[condition] if condition else PLAIN
    objects = []
    for index in range(count):
        example = scenes.scene(index, meshes, viewpoints, photographs, seed=seed)
        candidates = tuple(model for model in models if (model.name == example.model) != unknown_model)
        name = f"{condition}/{example.name}" if condition else example.name
        objects.append(replace(example, name=name, candidates=candidates))
    by = "all models but its own" if unknown_model else "its own model"
    start = "from a random azimuth and an elevation near the true one"
    return Examples(objects, f"{counted(count, 'scene')} of {origin}. Each object is compared with {by}, {start}.")
