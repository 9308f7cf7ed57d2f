"""Drawings of lines and texts as SVG, in colours that follow light and dark mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from ..io.images import Picture
from .environment import environment, png

Point = tuple[float, float]

COLOURS = {  # by name: in light mode and in dark mode
    "ground": ("#ffffff", "#15171a"),  # of pages
    "text": ("#282828", "#e4e6e8"),
    "grid": ("#e1e1e1", "#33383e"),
    "faint": ("#707070", "#8f979f"),
    "curve": ("#184a96", "#7cb0ff"),
    "path": ("#a85b00", "#f0a24a"),
    "mark": ("#d9170c", "#ff6b61"),
}


@dataclass(frozen=True)
class Shape:
    """A part of a drawing.

    Attributes:
        kind: "line", "dot", "text", "rectangle" or "image".
        points: of a line; of the others, the one place, of a rectangle and an image their upper left corner.
        colour: a key of :data:`COLOURS`.
        width: of a line, a rectangle and an image; radius of a dot.
        height: of a rectangle.
        text: of a text; of an image, its PNG in base64.
        fill: of a dot, a key of :data:`COLOURS`.
        anchor: of a text: "start", "middle" or "end" of it is at its place.
    """

    kind: str
    points: Sequence[Point]
    colour: str = "text"
    width: float = 1.0
    height: float = 0.0
    text: str = ""
    fill: str = "ground"
    anchor: str = "start"


@dataclass
class Drawing:
    """A drawing, to which shapes are added from the back to the front.

    Attributes:
        width, height: pixels; y grows downwards.
        title, description: for those who cannot see it.
        shapes: so far.
    """

    width: int
    height: int
    title: str
    description: str
    shapes: list[Shape] = field(default_factory=list)

    def line(self, points: Sequence[Point], colour: str, width: float = 1.0) -> None:
        """Adds a line through points."""
        self.shapes.append(Shape("line", points, colour, width))

    def dot(self, place: Point, colour: str, radius: float, *, ringed: bool = False) -> None:
        """Adds a dot, or a ring."""
        self.shapes.append(Shape("dot", [place], colour, radius, fill="ground" if ringed else colour))

    def note(self, place: Point, text: str, colour: str = "text", anchor: str = "start") -> None:
        """Adds a text, whose base line is at the place."""
        self.shapes.append(Shape("text", [place], colour, text=text, anchor=anchor))

    def rectangle(self, corner: Point, width: float, height: float, colour: str) -> None:
        """Adds a filled rectangle by its upper left corner."""
        self.shapes.append(Shape("rectangle", [corner], colour, width, height))

    def image(self, corner: Point, side: float, picture: Picture) -> None:
        """Adds a square picture by its upper left corner."""
        self.shapes.append(Shape("image", [corner], width=side, text=png(picture)))

    def svg(self) -> str:
        """The text of the SVG: a file, or a part of a page."""
        return environment().get_template("drawing.svg").render(drawing=self, colours=COLOURS)
