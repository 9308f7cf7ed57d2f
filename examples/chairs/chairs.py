"""Procedural chairs of many styles."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import chair_backs
import chair_bodies
import chair_legs
import numpy as np
import torch
from chair_backs import Back
from folding_chairs import folding
from padded_chairs import armchair, lounge
from solids import Generator, Parts, Solid, joined, outline, outward, slab
from stools import bench, stool
from swivel_chairs import swivel

from nablahog import Mesh


def chair(seed: int, kind: str | None = None) -> Mesh:
    """A random chair; the same seed and kind give the same chair.

    Of no kind, it is one of nine: wooden and Windsor chairs (straight, tapered, splayed, turned, curved and hairpin
    legs), tubular steel (runners or cantilevered), office chairs, pedestals, shells, tubs, upholstered and panelled
    armchairs.  Seats are about 45 cm high and 50 cm wide; each of these has a back, so that its front is defined; some
    have arms.  Others of :data:`KINDS` are made only when asked for.

    Args:
        seed: at least 0.
        kind: one of :data:`KINDS`; by default random.  A stool has no back, and looks the same from several sides.

    Returns:
        A normalised mesh of about a hundred to ten thousand faces, in the object's frame (z up, front to -y).  It is
        made of closed solids, which overlap where they meet; with a kind, their faces turn outwards.

    Raises:
        ValueError: ``seed`` is below 0, or there is no such kind.
    """
    if seed < 0:
        raise ValueError(f"a seed must be at least 0, got {seed}")
    generator = np.random.default_rng(seed)
    if kind is None:
        kinds = list(_KINDS)
        weights = np.array([_KINDS[each][0] for each in kinds])
        frame, cover = _KINDS[kinds[int(generator.choice(len(kinds), p=weights / weights.sum()))]][1](generator)
    elif kind in KINDS:
        make = _KINDS[kind][1] if kind in _KINDS else _ASKED[kind]
        frame, cover = ([outward(part) for part in parts] for parts in make(generator))
    else:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind!r}")
    light, dark = generator.uniform(0.1, 0.95, 2)
    tones = (light, dark if generator.random() < 0.6 else light)
    whole = joined([*frame, *cover])
    edge = sum(len(solid.vertices) for solid in frame)
    brightness = np.where(np.arange(len(whole.vertices)) < edge, *tones)
    return Mesh(*map(torch.from_numpy, (whole.vertices, whole.faces, brightness))).normalized()


def library() -> dict[str, Mesh]:
    """Chairs of all kinds by name: those that :func:`nablahog.sample_chairs` returns.

    ``"swivel-2"`` is ``chair(2, "swivel")``.
    """
    return {f"{kind}-{seed}": chair(seed, kind) for kind, seed in LIBRARY}


def _pick(generator: Generator, weights: Mapping[str, float]) -> str:
    total = sum(weights.values())
    return str(generator.choice(list(weights), p=[weight / total for weight in weights.values()]))


def _back(generator: Generator, width: float, y: float, z: float, low: float, high: float, curve: float = 6) -> Back:
    return Back(
        width=width,
        height=generator.uniform(low, high),
        y=y,
        z=z,
        tilt=generator.uniform(0, 0.3),
        curve=generator.uniform(0, curve),
        bend=generator.uniform(-2, 4),
        spread=generator.uniform(-0.15, 0.15),
    )


def _wooden(generator: Generator) -> Parts:
    width, depth, top = generator.uniform(38, 50), generator.uniform(37, 48), generator.uniform(42, 48)
    roundness = float(generator.choice([0.05, 0.3, 0.9], p=[0.5, 0.35, 0.15]))
    taper = generator.choice([0, generator.uniform(0.05, 0.25)])
    legs = _pick(generator, {"straight": 4, "tapered": 4, "splayed": 2, "turned": 2, "sabre": 1.5, "hairpin": 1})
    style = _pick(generator, {"solid": 3, "slats": 3, "ladder": 3, "frame": 3, "comb": 1, "bow": 1})
    narrow = width * (1 - taper) * (0.8 if roundness > 0.5 else 0.97)
    back = _back(generator, narrow, depth / 2 - 2, top - 1, 36, 62, curve=9 if roundness > 0.5 else 4)
    inset = width * (0.045 + 0.13 * max(0, roundness - 0.3))
    tops = chair_legs.corners(width, depth, inset, 2 * (width / 2 - inset - narrow / 2 + 2))
    frame = chair_legs.four(tops, top - 2, legs, generator)
    if legs in ("straight", "tapered", "sabre") and roundness < 0.5 and generator.random() < 0.6:
        frame += chair_bodies.apron(tops, top - 2, generator)
    cover = chair_bodies.seat(width, depth, top, roundness, taper, generator)
    frame, cover = _with_back(frame, cover, chair_backs.STYLES[style](back, generator), generator)
    if generator.random() < 0.25:
        kind = _pick(generator, {"posts": 3, "loop": 1})
        frame += chair_bodies.arms(back, width, depth, top, kind, generator)
    return frame, cover


def _with_back(frame: list[Solid], cover: list[Solid], back: list[Solid], generator: Generator) -> Parts:
    return (frame, cover + back) if generator.random() < 0.3 else (frame + back, cover)


def _windsor(generator: Generator) -> Parts:
    width, depth, top = generator.uniform(40, 50), generator.uniform(38, 46), generator.uniform(43, 47)
    shape = outline(width, depth, roundness=generator.uniform(0.4, 0.8), taper=generator.uniform(0, 0.15))
    cover = [slab(shape, [(top - 4.5, 0.85), (top - 2, 1), (top - 0.5, 1), (top, 0.97)])]
    back = _back(generator, width * 0.85, depth / 2 - 4, top - 1, 45, 65, curve=8)
    tops = chair_legs.corners(width, depth, 0.2 * width, 0)
    frame = chair_legs.four(tops, top - 3, _pick(generator, {"turned": 2, "splayed": 1}), generator)
    frame += chair_backs.STYLES[_pick(generator, {"bow": 2, "comb": 1})](back, generator)
    if generator.random() < 0.4:
        frame += chair_bodies.arms(back, width, depth, top, "posts", generator)
    return frame, cover


def _tubular(generator: Generator) -> Parts:
    width, depth, top = generator.uniform(42, 52), generator.uniform(40, 48), generator.uniform(43, 47)
    cover = chair_bodies.seat(width, depth, top, generator.uniform(0.05, 0.4), 0, generator)
    back = _back(generator, width - 1, depth / 2 - 1, top - 1, 32, 48)
    style = _pick(generator, {"solid": 3, "ladder": 1})
    cover += chair_backs.STYLES[style](back, generator)
    if generator.random() < 0.5:
        frame = chair_legs.sled(width, depth, top - 2, generator) + back.posts(0.8 * back.height, 2, round_=True)
    else:
        ends = [back.at(side, 0.8 * back.height) for side in (-1, 1)]
        frame = chair_legs.cantilever(width, depth, top - 3, ends, generator)
    if generator.random() < 0.4:
        frame += chair_bodies.arms(back, width, depth, top, "loop", generator)
    return frame, cover


def _office(generator: Generator) -> Parts:
    width, depth, top = generator.uniform(44, 54), generator.uniform(42, 50), generator.uniform(43, 54)
    cover = chair_bodies.seat(width, depth, top, generator.uniform(0.2, 0.6), generator.uniform(0, 0.15), generator)
    back = _back(generator, width * generator.uniform(0.75, 1), depth / 2 - 1, top - 1, 30, 70, curve=9)
    cover += chair_backs.spine(back, generator)
    frame = chair_legs.swivel(top - 5, generator)
    if generator.random() < 0.6:
        frame += chair_bodies.arms(back, width, depth, top, _pick(generator, {"tee": 3, "loop": 1}), generator)
    return frame, cover


def _pedestal(generator: Generator) -> Parts:
    width, depth, top = generator.uniform(42, 52), generator.uniform(40, 48), generator.uniform(43, 48)
    cover = chair_bodies.seat(width, depth, top, generator.uniform(0.5, 1), 0, generator)
    back = _back(generator, width * 0.85, depth / 2 - 2, top - 1, 25, 50, curve=12)
    cover += chair_backs.solid(back, generator)
    return chair_legs.pedestal(top - 3, generator), cover


def _shell(generator: Generator) -> Parts:
    width, depth, top = generator.uniform(42, 54), generator.uniform(40, 48), generator.uniform(43, 47)
    cover = chair_bodies.shell(width, depth, top, generator)
    legs = _pick(generator, {"splayed": 3, "hairpin": 2, "tapered": 2, "sled": 2, "swivel": 1, "pedestal": 2})
    if legs in chair_legs.SINGLE:
        frame = chair_legs.SINGLE[legs](top - 1, generator)
    elif legs == "sled":
        frame = chair_legs.sled(width * 0.8, depth * 0.85, top - 1.5, generator)
    else:
        frame = chair_legs.four(chair_legs.corners(width, depth, 0.22 * width, 0), top - 2, legs, generator)
        frame.append(slab(outline(0.62 * width, 0.62 * width, roundness=0.4), [(top - 4, 1), (top - 1.5, 1)]))
    return frame, cover


def _club(generator: Generator) -> Parts:
    width, depth, top = generator.uniform(68, 95), generator.uniform(65, 85), generator.uniform(40, 46)
    floor = generator.uniform(3, 16)
    legs = _pick(generator, {"tapered": 2, "straight": 1, "turned": 1}) if floor > 8 else "straight"
    tops = chair_legs.corners(width, depth, 7, 0)
    frame = chair_legs.feet(tops, floor + 2, legs, generator)
    return frame, chair_bodies.club(width, depth, top, floor, generator)


def _panelled(generator: Generator) -> Parts:
    width, depth, top = generator.uniform(52, 70), generator.uniform(52, 70), generator.uniform(38, 45)
    frame = chair_bodies.panelled(width, depth, top, generator)
    cover = chair_bodies.seat(width - 3, depth - 3, top, 0.1, 0, generator)
    back = _back(generator, width - 4, depth / 2 - 8, top - 3, 32, 52, curve=1)
    style = _pick(generator, {"solid": 3, "slats": 1, "ladder": 1})
    frame, cover = _with_back(frame, cover, chair_backs.STYLES[style](back, generator), generator)
    return frame, cover


def _tub(generator: Generator) -> Parts:
    width, depth, top = generator.uniform(55, 75), generator.uniform(52, 68), generator.uniform(40, 46)
    legs = _pick(generator, {"splayed": 2, "tapered": 2, "swivel": 1, "pedestal": 1})
    floor = generator.uniform(18, 30)
    cover = chair_bodies.tub(width, depth, top, floor, generator)
    if legs in chair_legs.SINGLE:
        return chair_legs.SINGLE[legs](floor + 1, generator), cover
    return chair_legs.feet(chair_legs.corners(width, depth, 0.2 * width, 0), floor + 1, legs, generator), cover


_KINDS: dict[str, tuple[float, Callable[[Generator], Parts]]] = {
    "wooden": (7, _wooden),
    "windsor": (2, _windsor),
    "tubular": (2, _tubular),
    "office": (3, _office),
    "pedestal": (1, _pedestal),
    "shell": (2, _shell),
    "club": (2, _club),
    "panelled": (1, _panelled),
    "tub": (1, _tub),
}
"""Relative frequency of each kind where none is asked for, and the function that makes it."""

_ASKED: dict[str, Callable[[Generator], Parts]] = {
    "swivel": swivel,
    "lounge": lounge,
    "armchair": armchair,
    "folding": folding,
    "stool": stool,
    "bench": bench,
}
"""Kinds that are only made when asked for, so that chairs of no kind stay what they are."""

KINDS = (*_KINDS, *_ASKED)
"""All kinds of chairs."""

_COUNTS = {
    **{"wooden": 6, "windsor": 2, "tubular": 3, "office": 2, "pedestal": 2, "shell": 3, "club": 2, "panelled": 1},
    **{"tub": 2, "swivel": 4, "lounge": 3, "armchair": 3, "folding": 3, "stool": 2, "bench": 2},
}
LIBRARY = tuple((kind, seed) for kind, count in _COUNTS.items() for seed in range(count))
"""Kind and seed of each model of :func:`library`."""
