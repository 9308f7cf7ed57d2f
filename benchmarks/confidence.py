"""Is the confidence of a pose the share of poses that are right, and what is it where there is no object?

    python benchmarks/confidence.py scenes FILE [--models DIR …] [--several] [--objects 100] [--seed 21]
        [--clutter DIR …] [--within DEGREES [--off DEGREES]]
    python benchmarks/confidence.py absent FILE [--models DIR …] [--several] [--objects 100] [--seed 21]
        [--photographs DIR …] [--textures bricks …] [--within DEGREES]
    python benchmarks/confidence.py fit FILE …
    python benchmarks/confidence.py judge FILE …

``scenes`` and ``absent`` search for poses, and append the evidence for each to a file of JSON lines, from which they
also go on after an interruption.  Scenes have boxes of all kinds, the look of two renderers, and photographs or walls
behind the object, which may be small; right is a rotation within 15°.  Images without the object are searched with a
random box, without any, and with ``--several`` among 40 models.  With ``--within`` azimuths are searched that far from
one that is off by two thirds of it at most, and by ``--off`` besides; without an object from a random one.  ``fit``
prints the weights that are in ``nablahog.pose.confidence``; ``judge`` the tables of other files: by those weights, so
that no search is run again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize

from absent import TEXTURES, absent_images, plain_backgrounds, random_box
from calibration import calibrated
from nablahog import Mesh, PoseEstimate, estimate_pose, sample_chairs
from nablahog.io.images import SAMPLE_NAMES, read_image, sample_photograph
from nablahog.metrics import rotation_error
from nablahog.paper.annotations import Example, sample_viewpoints
from nablahog.paper.examples import CONDITIONS, PLAIN
from nablahog.pose import confidence
from nablahog.pose.confidence import KNOWN_MODEL, Evidence, Weights, probabilities
from nablahog.pose.result import see_opposite_sides
from nablahog.render.models import check_models, read_models
from nablahog.requests.pose import LEAST_CONFIDENCE
from poses import WITHIN
from timing import table

Floats: TypeAlias = NDArray[np.float64]
Record: TypeAlias = dict[str, Any]
Case: TypeAlias = tuple[str, Callable[[], PoseEstimate], Example | None]  # its name, the search, the truth

CASES = ("", "exact", "sides-10", "cut-30", "no-box", "tilted", "steep", "renderer")  # conditions; "" for none
SEVERAL = (12, 23, 39)  # candidates
SMALL, SMALL_HEIGHT = 128, (35.0, 100.0)  # of a scene in six
HINT_ERROR = 2 / 3  # of the range of azimuths: the most that the middle of it is off
EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)
PENALTY = 0.01  # of squared weights in units of their standard deviation
FREE = {  # the figures whose weights are fitted, and the share that images without the object have then of all poses
    "KNOWN_MODEL": (("similarity", "penalty", "sidelobe"), 1 / 3),
    "UNKNOWN_MODEL": (("penalty", "sidelobe", "agreement", "upright"), 1 / 2),
}


def meshes(folders: list[Path]) -> dict[str, Mesh]:
    if not folders:
        return dict(sample_chairs())
    read = [check_models(read_models(folder)[0])[0] for folder in folders]
    return {f"{folder.name}/{one.name}": one.mesh() for folder, some in zip(folders, read, strict=True) for one in some}


def scenes(options: argparse.Namespace) -> Iterator[tuple[str, Example, dict[str, Mesh]]]:
    """The name of each scene, the object, and the candidates."""
    models, seed = meshes(options.models), options.seed
    viewpoints = sample_viewpoints(10_000, np.random.default_rng(seed))
    photographs = [sample_photograph(name) for name in SAMPLE_NAMES]
    photographs += [read_image(file) for folder in options.clutter for file in sorted(folder.iterdir())[::20]]
    walls = [*islice(plain_backgrounds(np.random.default_rng(seed)), 24)]
    for index in range(options.objects):
        generator = np.random.default_rng([seed, index, 9])
        name = CASES[index % len(CASES)]
        condition = CONDITIONS[name] if name else PLAIN
        if generator.random() < 0.5:
            condition = replace(condition, settings=CONDITIONS["renderer"].settings)
        kind = generator.integers(6)
        if kind == 0:
            condition = replace(condition, settings=replace(condition.settings, size=SMALL, height=SMALL_HEIGHT))
        example = condition.scene(index, models, viewpoints, walls if kind == 1 else photographs, seed=seed)
        if generator.random() < 0.75:
            example = replace(example, initial=None)
        assert example.model is not None
        candidates = [example.model]
        if options.several:
            others = generator.permutation([other for other in models if other != example.model])
            candidates = sorted(others[: generator.choice(SEVERAL)].tolist())
        yield f"{index}-{name or 'jittered'}", example, {name: models[name] for name in candidates}


def record(result: PoseEstimate, example: Example | None) -> Record:
    """What is known of a pose, and which of it and its runners-up is right."""

    truth = None if example is None else (example.azimuth, example.elevation, example.theta)

    def right(pose: PoseEstimate) -> bool:
        if truth is None:
            return False
        azimuths = (pose.azimuth, *pose.equivalent_azimuths)
        views = [(azimuth, pose.elevation, pose.theta) for azimuth in azimuths]
        return bool(rotation_error(views, truth).min() <= WITHIN)

    assert result.evidence is not None
    poses = (result, *result.runners_up)
    opposite = truth is not None and see_opposite_sides((result.azimuth, result.elevation, result.theta), truth)
    found = {"right": [right(pose) for pose in poses], "opposite": opposite, "absent": example is None}
    return {**found, "evidence": asdict(result.evidence)}


def collect(options: argparse.Namespace) -> None:
    """Searches for the poses that the file does not have yet."""
    options.file.touch()
    done = {json.loads(line)["name"] for line in options.file.read_text().splitlines()}
    with options.file.open("a") as out:
        for name, search, example in options.cases(options):
            if name not in done:
                found = {"name": name, **record(search(), example)}
                print(json.dumps(found), file=out, flush=True)


def scene_cases(options: argparse.Namespace) -> Iterator[Case]:
    for index, (name, example, models) in enumerate(scenes(options)):
        bound = bound_azimuth(options, index, example)
        known = {"box": example.box, "initial": example.initial, **prior_of(options), **bound}
        yield name, partial(estimate_pose, example.image, models, **known), example


def prior_of(options: argparse.Namespace) -> dict[str, Any]:
    return {"viewpoints": None} if options.no_viewpoints else {}


def bound_azimuth(options: argparse.Namespace, index: int, example: Example | None = None) -> dict[str, Any]:
    if options.within is None:
        return {}
    generator = np.random.default_rng([options.seed, index, 7])
    if example is None:
        return {"initial": (generator.uniform(0, 360), 15.0), "within": options.within}
    reach = HINT_ERROR * options.within
    azimuth = example.azimuth + options.off + generator.uniform(-reach, reach)
    return {"initial": (azimuth % 360, example.elevation), "within": options.within}


def absent_cases(options: argparse.Namespace) -> Iterator[Case]:
    models = [*meshes(options.models).items()]
    images = absent_images(options.photographs, options.textures, options.objects, options.seed)
    for index, (name, image) in enumerate(images):
        generator = np.random.default_rng([options.seed, index, 8])
        count = max(SEVERAL) + 1 if options.several else 1
        candidates = dict(sorted(models[k] for k in generator.permutation(len(models))[:count]))
        box = random_box(image, generator)
        boxes = {"box": box, "no box": None}
        for kind in [("box", "no box")[index % 2]] if options.several else boxes:
            known = {"box": boxes[kind], **prior_of(options), **bound_azimuth(options, index)}
            search = partial(estimate_pose, image, candidates, **known)
            yield f"{index}-{kind} {name}", search, None


@cache
def read(files: tuple[Path, ...]) -> list[Record]:
    lines = (line for file in files for line in file.read_text().splitlines())
    return [json.loads(line) for line in lines]


def evidence_of(found: Mapping[str, Any]) -> Evidence:
    return Evidence(**{**found["evidence"], "shares": tuple(found["evidence"]["shares"])})


def fit_weights(records: list[Record], free: tuple[str, ...], absent_share: float) -> Weights:
    """The weights of greatest likelihood: one of the pose, its runners-up and none of them is right."""
    evidence = [evidence_of(found) for found in records]
    start = Weights(*np.zeros(len(Weights._fields)))._replace(share=1.0)
    columns = np.array([[describe(one, name) for name in free] for one in evidence])
    spread = columns.std(axis=0)

    def weights(values: Floats) -> Weights:
        scaled = dict(zip(free, values[2:] / spread, strict=True))
        return start._replace(constant=values[0], share=values[1], **scaled)

    absent = np.array([found["absent"] for found in records])
    counts = np.where(
        absent, absent_share / max(absent.mean(), 1e-9), (1 - absent_share) / max(1 - absent.mean(), 1e-9)
    )

    def loss(values: Floats) -> float:
        total = PENALTY * float(np.square(values[2:]).sum())
        for one, found, count in zip(evidence, records, counts, strict=True):
            sure = probabilities(one, weights(values))
            right = [p for p, is_right in zip(sure, found["right"], strict=True) if is_right]
            total -= count * float(np.log(max(right[0] if right else 1 - sum(sure), 1e-9)))
        return total

    bounds = [(None, None), (0.0, None), *[(None, None)] * len(free)]
    first = np.concatenate([[-5.0, 5.0], np.zeros(len(free))])
    return weights(minimize(loss, first, method="L-BFGS-B", bounds=bounds).x)


def describe(evidence: Evidence, name: str) -> float:
    """A figure of the evidence, as its weight is for."""
    return float(np.log1p(max(evidence.similarity, 0))) if name == "similarity" else float(getattr(evidence, name))


def fit(options: argparse.Namespace) -> None:
    records = read(tuple(options.files))
    for name, (free, absent_share) in FREE.items():
        stored: Weights = getattr(confidence, name)
        some = [found for found in records if found["evidence"]["known_model"] == (stored is KNOWN_MODEL)]
        if some:
            fitted = [f"{value:.2f}" for value in fit_weights(some, free, absent_share)]
            rows = [[field, *pair] for field, *pair in zip(Weights._fields, fitted, map(str, stored), strict=True)]
            print(f"{name}: {len(some)} poses\n")
            print(table(["weight", "fitted", "in the source"], rows), end="\n\n")


def judge(options: argparse.Namespace) -> None:
    records = read(tuple(options.files))
    sure = np.array([probabilities(evidence_of(found))[0] for found in records])
    right = np.array([float(found["right"][0]) for found in records])
    absent = np.array([found["absent"] for found in records])
    print(f"{len(records)} poses, {absent.sum()} of them without an object\n")
    print(calibrated(sure, right, EDGES), end="\n\n")
    for kind in ("box", "no box"):
        of_kind = absent & np.array([found["name"].split("-", 1)[1].startswith(kind) for found in records])
        if of_kind.any():
            above = (sure[of_kind] >= LEAST_CONFIDENCE).sum()
            print(f"Without the object, {kind}: {above} of {of_kind.sum()} have {LEAST_CONFIDENCE} or more")
    if (right > 0).any():
        shares = [f"{(sure[right > 0] >= least).mean():.3f} have {least} or more" for least in (LEAST_CONFIDENCE, 0.8)]
        print(f"Of right poses {', '.join(shares)}")
    turned(records, sure, right)


def turned(records: list[Record], sure: Floats, right: Floats) -> None:
    """Half turns among the wrong poses, and how probable they are said to be."""
    wrong = [found for found, is_right in zip(records, right, strict=True) if not (is_right or found["absent"])]
    half = [found for found in wrong if found["opposite"]]
    rivals = [
        pair
        for found in records
        for pair in zip(probabilities(evidence_of(found))[1:], found["right"][1:], strict=True)
    ]
    print(f"Of {len(wrong)} wrong poses {len(half)} see the opposite side")
    if rivals:
        print("\nRunners-up\n")
        chances, is_right = np.array(rivals, dtype=float).T
        print(calibrated(chances, is_right, (0.0, 0.05, 0.15, 0.3, 1.0)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for name, cases in (("scenes", scene_cases), ("absent", absent_cases)):
        command = commands.add_parser(name)
        command.add_argument("file", type=Path)
        command.add_argument("--models", type=Path, nargs="+", default=[], help="folders; by default chairs that ship")
        command.add_argument("--several", action="store_true", help="search among several models, not the own one")
        command.add_argument("--no-viewpoints", action="store_true", help="without the viewpoint prior")
        command.add_argument("--objects", type=int, default=100)
        command.add_argument("--seed", type=int, default=21)
        command.add_argument("--threads", type=int, default=1)
        command.add_argument("--within", type=float, help="search azimuths so many degrees from one that is given")
        if name == "scenes":
            command.add_argument("--off", type=float, default=0.0, help="how far that one is off besides, degrees")
            command.add_argument("--clutter", type=Path, nargs="+", default=[], help="folders of photographs behind")
        else:
            command.add_argument("--photographs", type=Path, nargs="+", default=[], help="folders")
            command.add_argument("--textures", nargs="*", choices=[*TEXTURES], default=[*TEXTURES])
        command.set_defaults(run=collect, cases=cases)
    for name, run in (("fit", fit), ("judge", judge)):
        command = commands.add_parser(name)
        command.add_argument("files", type=Path, nargs="+")
        command.set_defaults(run=run, threads=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    options.run(options)


if __name__ == "__main__":
    main()
