"""The steps of the search for a pose: views all around, views elsewhere, small turns, ascents."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property, partial
from threading import Lock

import torch
from torch import Tensor

from ..hog.box import Box
from ..runtime.threads import in_threads
from .ascent import SCHEDULE, Round, lbfgs_ascent, momentum_ascent, quadratic_ascent
from .candidates import candidates
from .confidence import Evidence
from .hypothesis import Hypothesis
from .placement import bounding_boxes, equidistant_azimuths, level_poses, local_maxima
from .prepared import DETAIL, PreparedModel, PreparedPhotograph
from .problem import PoseProblem, RunnerUp, SearchResult
from .pyramid import FOUND, ROUGH, Pyramid, pyramid
from .similarity import Similarity
from .symmetry import equivalent_azimuths
from .viewpoint_evidence import at_azimuths, azimuth_evidence
from .views import VIEW_COUNT, view_similarities

VOTERS = 36  # views of several models that are tilted and ascended from, of those that fill the box and of others
VOTE = SCHEDULE[:2]  # of their ascents: which side of the object they see does not take more
_SAME_BOX = 0.85  # intersection over union: a view whose box is as near fills the one given
_STARTS = 4  # local maxima of a model's views, at most, that are tilted
_NEARLY = 0.75  # of the best view's similarity: others that have as much may still turn out to be the best
_TURNS, _TILTS = (-5.0, 0.0, 5.0), (-10.0, -5.0, 0.0, 5.0, 10.0)  # degrees of azimuth and in the image plane
_ASCENT_STEPS = 30


class Search:
    """The steps of the search, their templates, and the number of renderings."""

    def __init__(self, problem: PoseProblem) -> None:
        self.problem = problem
        self.kind = problem.similarity or "calibrated"
        self.voting = len(problem.models) > 1 and self.kind == "calibrated"
        self.renderings = 0
        self._lock = Lock()

    def look_around(self) -> list[Hypothesis]:
        """The best views of all models at all elevations, the best of all first, as many as are looked at closer."""
        azimuths = equidistant_azimuths(VIEW_COUNT)
        level = {elevation: level_poses(azimuths[:1], elevation) for elevation in self.problem.elevations}
        unlikely = {at: float(self.problem.unlikely(pose, self.problem.photograph)) for at, pose in level.items()}
        seen: list[tuple[float, float, str, float, Tensor]] = []
        for name, model in self.problem.each_model():
            for elevation in self.problem.elevations:
                values = self._view_similarities(model, elevation)
                values[~self._allowed] = -torch.inf
                best = local_maxima(values, _STARTS)
                for value, azimuth in zip(values[best].tolist(), azimuths[best], strict=True):
                    seen.append((value - unlikely[elevation], value, name, elevation, azimuth))
                self.renderings += VIEW_COUNT
        seen = sorted((one for one in seen if math.isfinite(one[0])), key=lambda one: -one[0])
        return [self._level_view(*one[1:]) for one in seen[: self._closer]]

    def _level_view(self, value: float, name: str, elevation: float, azimuth: Tensor) -> Hypothesis:
        (pose,) = self.problem.level_views(self.problem.models[name], azimuth[None], elevation)
        return self._hypothesis(value, name, pose, self.problem.photograph, self.problem.photograph)

    @property
    def _closer(self) -> int:
        """How many views are looked at closer, at most."""
        return VOTERS if self.voting else _STARTS

    @cached_property
    def _allowed(self) -> Tensor:
        """Which of the views around a model are searched, (VIEW_COUNT,)."""
        return self.problem.allowed(equidistant_azimuths(VIEW_COUNT))

    @property
    def searches_boxes(self) -> bool:
        """Whether poses are compared whatever box they fill, which only the calibrated similarity allows."""
        return self.kind == "calibrated"

    def look_elsewhere(self) -> list[Hypothesis]:
        """The best views that fill another box, or are tilted, the best of all first."""
        seen = [
            (value - float(self.problem.unlikely(pose[None], photograph)), value, name, photograph, pose)
            for name, model in self.problem.models.items()
            for photograph, around in self._pyramids
            for value, pose in self._around(model, photograph, around)
        ]
        best = sorted(seen, key=lambda one: -one[0])[: self._closer]
        views = (self._reframed(*one[1:]) for one in best)
        return [view for view in views if view is not None]

    def _around(
        self, model: PreparedModel, photograph: PreparedPhotograph, around: Pyramid
    ) -> Iterator[tuple[float, Tensor]]:
        """Similarities of the best views of a model around a crop, and their poses for that."""
        found = candidates(model, photograph, around, self.problem.elevations, self._allowed, _STARTS)
        yield from zip(found.similarities.tolist(), found.poses, strict=True)

    def _reframed(self, value: float, name: str, photograph: PreparedPhotograph, pose: Tensor) -> Hypothesis | None:
        """A view with the crop around it, unless it is there; None for views that fill the given box."""
        model, crop = self.problem.models[name], photograph.crop
        (box,) = bounding_boxes(pose[None], model.hull, crop.camera)
        if Box.of(box.tolist()).iou(crop.centred_box) >= _SAME_BOX:
            if pose[3] == 0 and photograph is self.problem.photograph:
                return None  # that view is there
            (pose,) = self.problem.fit(model, pose[None], photograph)
            return self._hypothesis(value, name, pose, photograph, photograph)
        other = self.problem.cropped(crop.box_in_photograph(box))
        return self._hypothesis(value, name, crop.converted(pose, other.crop), other, photograph)

    @cached_property
    def _pyramids(self) -> list[tuple[PreparedPhotograph, Pyramid]]:
        """Crops with what is around them."""
        problem = self.problem
        photographs = [problem.photograph, *map(problem.cropped, problem.boxes or ())]
        reach = ROUGH if problem.boxes is None else FOUND
        return [(one, pyramid(one, problem.image, problem.tilts, reach)) for one in photographs]

    def _hypothesis(
        self, value: float, name: str, pose: Tensor, photograph: PreparedPhotograph, place: PreparedPhotograph
    ) -> Hypothesis:
        unlikely = float(self.problem.unlikely(pose[None], photograph))
        hypothesis = Hypothesis(value, name, pose, photograph, place, ((float(pose[0]), value),), unlikely)
        self._watch(hypothesis, pose)
        return hypothesis

    def _watch(self, hypothesis: Hypothesis, pose: Tensor) -> None:
        given = self.problem.photograph.crop
        with self._lock:
            self.problem.watch(hypothesis.model, hypothesis.photograph.crop.converted(pose, given))

    def _view_similarities(self, model: PreparedModel, elevation: float) -> Tensor:
        if self.kind == "calibrated":
            return view_similarities(model, self.problem.photograph.calibrated, elevation)
        # without calibration an object of another size has another similarity
        poses = self.problem.level_views(model, equidistant_azimuths(VIEW_COUNT), elevation)
        return self._similarity_of(model, self.problem.photograph, fine=False).values(poses)

    def tilt_each(self, views: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The best of small turns of azimuth and in the image plane, of each view.

        The two are hard to tell apart: seen from above, either moves the top of an object across its foot.
        """
        similarities = [self._similarity(view, fine=False) for view in views]  # made before threads ask for them
        return in_threads(lambda k: self._tilt(views[k], similarities[k]), len(views))

    def _tilt(self, view: Hypothesis, coarse: Similarity) -> Hypothesis:
        model = self.problem.models[view.model]
        poses = view.pose.repeat(len(_TILTS) * len(_TURNS), 1)
        poses[:, [0, 3]] += torch.cartesian_prod(torch.tensor(_TURNS), torch.tensor(_TILTS))
        poses = self.problem.fit(model, poses, view.photograph)
        values = coarse.values(poses)
        self._count(len(poses))
        unlikely = self.problem.unlikely(poses, view.photograph)
        best = int((values - unlikely).argmax())
        pose, value = poses[best], float(values[best])
        self._watch(view, pose)
        return view.refined(pose, value, value, float(unlikely[best]))

    def promising(self, views: Sequence[Hypothesis]) -> Sequence[Hypothesis]:
        """Of ``views``, which are the best first, those that are nearly as good as the best; for a vote all."""
        if self.voting or not views:
            return views
        least = views[0].score - (1 - _NEARLY) * abs(views[0].score)
        return [view for view in views if view.score >= least]

    def ascend_each(self, starts: Sequence[Hypothesis], rounds: Sequence[Round] = SCHEDULE) -> list[Hypothesis]:
        """The highest similarity near each start.

        Args:
            starts: of any models.
            rounds: of quadratic ascents.
        """
        similarities = [self._similarity(start, fine=True) for start in starts]
        seeds = torch.randint(2**62, (len(starts),), generator=self.problem.generator).tolist()
        return in_threads(lambda k: self._ascend(starts[k], similarities[k], rounds, seeds[k]), len(starts))

    def _ascend(self, start: Hypothesis, fine: Similarity, rounds: Sequence[Round], seed: int) -> Hypothesis:
        pose = self._maximum(start, fine, rounds, torch.Generator().manual_seed(seed))
        value = float(fine.values(pose[None]))
        self._count(fine.renderings)
        unlikely = float(self.problem.unlikely(pose[None], start.photograph))
        return start.refined(pose, value, self._value(start, pose, fine=False), unlikely)

    def _maximum(
        self, start: Hypothesis, similarity: Similarity, rounds: Sequence[Round], generator: torch.Generator
    ) -> Tensor:
        pose, visit = start.pose, partial(self._watch, start)
        if self.problem.ascent == "quadratic":
            return quadratic_ascent(similarity, pose, rounds, generator, visit)
        if self.problem.ascent == "momentum":
            return momentum_ascent(similarity, pose[None], steps=_ASCENT_STEPS, distance_every=1, visit=visit)[0][0]
        return lbfgs_ascent(similarity, pose, _ASCENT_STEPS)

    def azimuth_evidence(self, poses: Sequence[Hypothesis]) -> Tensor:
        """How likely their azimuths are whatever the model, logarithms, (N,)."""
        places = list(dict.fromkeys(one.place for one in poses))  # in a crop of its own a pose would confirm itself
        evidence = azimuth_evidence(self.problem, self.problem.viewpoints, places)
        rows = torch.tensor([places.index(one.place) for one in poses])
        return at_azimuths(evidence[rows], torch.tensor([one.azimuth for one in poses], dtype=torch.float64))

    def seen_from(self, viewpoint: Tensor, of: Hypothesis) -> Hypothesis:
        """A pose at another azimuth, elevation and in-plane rotation, (3,), degrees."""
        pose = of.pose.clone()
        pose[[0, 1, 3]] = viewpoint
        return of.refined(pose, self._value(of, pose, fine=True), self._value(of, pose, fine=False))

    def same_view(self, of: Hypothesis) -> tuple[float, ...]:
        """Other azimuths from which the model looks the same, degrees."""
        elevation = min(self.problem.elevations, key=lambda each: abs(each - float(of.pose[1])))  # one with views
        return equivalent_azimuths(self.problem.models[of.model], of.azimuth, elevation)

    def result(
        self, best: Hypothesis, traced: Sequence[Hypothesis], runners_up: tuple[RunnerUp, ...], evidence: Evidence
    ) -> SearchResult:
        """The best pose, for the crop of the problem."""
        return SearchResult(
            best.model,
            best.photograph.crop.converted(best.pose, self.problem.photograph.crop),
            best.similarity,
            self.kind,
            self.renderings,
            tuple(one.search_trace() for one in traced),
            runners_up,
            self.same_view(best),
            evidence if self.kind == "calibrated" else None,
        )

    def _value(self, of: Hypothesis, pose: Tensor, *, fine: bool) -> float:
        self._count(1)
        return float(self._similarity(of, fine=fine).values(pose[None]))

    def _count(self, renderings: int) -> None:
        with self._lock:
            self.renderings += renderings

    def _similarity(self, of: Hypothesis, *, fine: bool) -> Similarity:
        """To a hypothesis' crop; of the kinds only the calibrated one has smaller cells in the last steps."""
        return self._similarity_of(self.problem.models[of.model], of.photograph, fine=fine)

    def _similarity_of(self, model: PreparedModel, photograph: PreparedPhotograph, *, fine: bool) -> Similarity:
        calibrated = self.kind == "calibrated"
        template = photograph.fine if fine and calibrated else photograph.template(self.kind)
        return model.similarity(template, detail=DETAIL, camera=photograph.crop.camera)
