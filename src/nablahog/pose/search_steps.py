"""The steps of the default search: views all around, and ascents from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from threading import Lock

import torch
from torch import Tensor

from ..inputs.boxes import Box
from ..runtime.pytorch import in_threads
from .ascent import SCHEDULE, Round, quadratic_ascent
from .model import (
    DETAIL,
    VIEW_COUNT,
    PreparedModel,
    bounding_boxes,
    equidistant_azimuths,
    local_maxima,
    reverse_depth,
    view_descriptors,
)
from .photograph import PreparedPhotograph
from .problem import PoseProblem, wrap_angles, wrap_hessian
from .similarity import Similarity
from .surroundings import FOUND, ROUGH, describe_surroundings, find_views
from .vote import Hypothesis

VOTERS = 36  # views of several models that are tilted and ascended from, inside the box and again around it
_SAME_BOX = 0.85  # intersection over union from which on a view fills the box that was given
_VIEW_MAXIMA = 4  # local maxima of a model's views, at most, from which a search goes on
_OTHER_VIEWS = 6  # of a single model, of another box or tilted: the right one is nearly always among them
COARSE_SCHEDULE = Round(4, 1.0, slopes=True), Round(4, 0.8, slopes=True)  # of ascents from views of a single model
_TURNS, _TILTS = (-5.0, 0.0, 5.0), (-10.0, -5.0, 0.0, 5.0, 10.0)  # degrees of azimuth and in the image plane


class SearchSteps:
    """The steps of a search, and the similarities that they have used."""

    def __init__(self, problem: PoseProblem) -> None:
        self.problem = problem
        self.calibrated = problem.similarity == "calibrated"  # only then can poses be compared whatever box they fill
        self.voting = len(problem.models) > 1 and self.calibrated
        self._similarities: list[Similarity] = []
        self._cached_views = 0  # that were compared with the photograph
        self._watching = Lock()

    @property
    def renderings(self) -> int:
        """How many renderings were compared with the photograph."""
        return self._cached_views + sum(similarity.renderings for similarity in self._similarities)

    def find_level_views(self) -> list[Hypothesis]:
        """The best views of all models at all elevations, the best first."""
        azimuths, penalties = equidistant_azimuths(VIEW_COUNT), self.problem.level_penalties
        rated: list[tuple[float, float, str, float, Tensor]] = []
        for name, model in self.problem.iterate_models():
            for elevation in self.problem.elevations:
                values = self._view_similarities(model, elevation)
                values[~self.problem.allowed] = -torch.inf
                best = local_maxima(values, _VIEW_MAXIMA)
                for value, azimuth in zip(values[best].tolist(), azimuths[best], strict=True):
                    rated.append((value - penalties[elevation], value, name, elevation, azimuth))
        finite = sorted((view for view in rated if math.isfinite(view[0])), key=lambda view: -view[0])
        return [self._place_level_view(*view[1:]) for view in finite[: VOTERS if self.voting else _VIEW_MAXIMA]]

    def find_other_views(self) -> list[Hypothesis]:
        """The best views of all models that fill another box or are tilted, the best first."""
        problem, rated = self.problem, []
        maxima, most = (_VIEW_MAXIMA, VOTERS) if self.voting else (_OTHER_VIEWS, _OTHER_VIEWS)
        places = [problem.photograph, *map(problem.crop_around, problem.other_boxes or ())]
        reach = ROUGH if problem.other_boxes is None else FOUND
        surroundings = [describe_surroundings(place, problem.image, problem.tilts, reach) for place in places]
        for name, model in problem.models.items():
            for place, around in zip(places, surroundings, strict=True):
                views = find_views(model, place, around, problem.elevations, problem.allowed, maxima)
                for pose, value in zip(views[0], views[1].tolist(), strict=True):
                    rated.append((value - float(problem.penalty(pose[None], place)), value, name, place, pose))
        best = sorted(rated, key=lambda view: -view[0])[:most]
        reframed = (self._reframe(*view[1:]) for view in best)
        return [view for view in reframed if view is not None]

    def climb(self, views: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The end of a short ascent of the coarse similarity from each view, or the view if it is no better."""
        climbed = self.ascend(views, COARSE_SCHEDULE, fine=False)
        return [max(pair, key=lambda hypothesis: hypothesis.score) for pair in zip(views, climbed, strict=True)]

    def tilt(self, views: Sequence[Hypothesis]) -> list[Hypothesis]:
        """The best of small turns of azimuth and in the image plane, of each view.

        The two are hard to tell apart: seen from above, either moves the top of an object across its foot.
        """
        similarities = [self._similarity(view) for view in views]  # made before threads ask for them
        return in_threads(lambda k: self._tilt(views[k], similarities[k]), len(views))

    def ascend(
        self, starts: Sequence[Hypothesis], rounds: Sequence[Round] = SCHEDULE, *, fine: bool = True, repeats: int = 0
    ) -> list[Hypothesis]:
        """The highest similarity near each start, of any models, by rounds of quadratic ascents."""
        similarities = [self._similarity(start, fine=fine) for start in starts]
        seeds = torch.randint(2**62, (len(starts),), generator=self.problem.generator).tolist()
        return in_threads(lambda k: self._ascend(starts[k], similarities[k], rounds, seeds[k], repeats), len(starts))

    def start_reversed(self, hypothesis: Hypothesis) -> list[Hypothesis]:
        """A start at the pose with reversed depth, if its azimuth is allowed."""
        pose = reverse_depth(hypothesis.pose)
        if not self.problem.allows(float(pose[0])):
            return []
        value = float(self._similarity(hypothesis).values(pose[None]))
        return [self._start(value, hypothesis.model, pose, hypothesis.photograph, hypothesis.place)]

    def move_to_viewpoint(self, start: Hypothesis, viewpoint: Tensor) -> Hypothesis:
        """The pose at another azimuth, elevation and in-plane rotation, (3,), degrees."""
        pose = start.pose.clone()
        pose[[0, 1, 3]] = viewpoint
        pose = self.problem.limit_azimuths(pose[None])[0]
        fine, coarse = (float(self._similarity(start, fine=fine).values(pose[None])) for fine in (True, False))
        return start.move(pose, fine, coarse, float(self.problem.penalty(pose[None], start.photograph)))

    def _view_similarities(self, model: PreparedModel, elevation: float) -> Tensor:
        """Similarities (VIEW_COUNT,) of views all around."""
        photograph = self.problem.photograph
        if self.calibrated:
            views = view_descriptors(model, elevation, photograph.own_background)
            self._cached_views += VIEW_COUNT
            return (views.flatten(1) @ photograph.calibrated.weights.flatten()).double()
        # without calibration the similarity depends on the size of the object
        poses = self.problem.level_views(model, equidistant_azimuths(VIEW_COUNT), elevation)
        return self._make_similarity(model, photograph).values(poses)

    def _place_level_view(self, value: float, name: str, elevation: float, azimuth: Tensor) -> Hypothesis:
        (pose,) = self.problem.level_views(self.problem.models[name], azimuth[None], elevation)
        return self._start(value, name, pose, self.problem.photograph, self.problem.photograph)

    def _reframe(self, value: float, name: str, place: PreparedPhotograph, pose: Tensor) -> Hypothesis | None:
        """A view with the crop around it; None for one beyond the photograph, or level ones that fill the given box."""
        model, crop = self.problem.models[name], place.crop
        (box,) = bounding_boxes(pose[None], model.hull, crop.camera)
        if Box(*box.tolist()).iou(crop.centred_box) >= _SAME_BOX:
            if pose[3] == 0 and place is self.problem.photograph:
                return None
            (pose,) = self.problem.fit(model, pose[None], place)
            return self._start(value, name, pose, place, place)
        around = crop.box_in_photograph(box)
        inside = around.intersect(Box(0, 0, *self.problem.image.shape[:0:-1]))
        if min(inside.width, inside.height) < 1:
            return None
        other = self.problem.crop_around(around)
        return self._start(value, name, crop.convert_pose(pose, other.crop), other, place)

    def _start(
        self, value: float, name: str, pose: Tensor, photograph: PreparedPhotograph, place: PreparedPhotograph
    ) -> Hypothesis:
        penalty = float(self.problem.penalty(pose[None], photograph))
        hypothesis = Hypothesis(value, name, pose, photograph, place, ((float(pose[0]), value),), penalty)
        self._watch(hypothesis, pose)
        return hypothesis

    def _tilt(self, view: Hypothesis, coarse: Similarity) -> Hypothesis:
        poses = view.pose.repeat(len(_TILTS) * len(_TURNS), 1)
        turns, tilts = (torch.tensor(angles, dtype=poses.dtype) for angles in (_TURNS, _TILTS))
        poses[:, [0, 3]] += torch.cartesian_prod(turns, tilts)
        poses = self.problem.fit(self.problem.models[view.model], self.problem.limit_azimuths(poses), view.photograph)
        values = coarse.values(poses)
        penalties = self.problem.penalty(poses, view.photograph)
        best = int((values - penalties).argmax())
        pose, value = poses[best], float(values[best])
        self._watch(view, pose)
        return view.move(pose, value, value, float(penalties[best]))

    def _ascend(
        self, start: Hypothesis, similarity: Similarity, rounds: Sequence[Round], seed: int, repeats: int
    ) -> Hypothesis:
        generator, limit = torch.Generator().manual_seed(seed), self.problem.limit_azimuths
        watch = partial(self._watch, start)
        pose, hessian = quadratic_ascent(similarity, start.pose, rounds, generator, watch, limit, repeats=repeats)
        value = float(similarity.values(pose[None]))
        climbing = similarity.template is start.photograph.template(self.problem.similarity)  # the coarse one itself
        coarse = value if climbing else float(self._similarity(start).values(pose[None]))
        penalty = float(self.problem.penalty(pose[None], start.photograph))
        return start.move(wrap_angles(pose), value, coarse, penalty, wrap_hessian(hessian, pose))

    def _watch(self, hypothesis: Hypothesis, pose: Tensor) -> None:
        crop = self.problem.photograph.crop
        with self._watching:
            self.problem.watch(hypothesis.model, hypothesis.photograph.crop.convert_pose(pose, crop))

    def _similarity(self, hypothesis: Hypothesis, *, fine: bool = False) -> Similarity:
        """The similarity to a hypothesis's crop; only the calibrated kind has smaller cells in the last steps."""
        return self._make_similarity(self.problem.models[hypothesis.model], hypothesis.photograph, fine=fine)

    def _make_similarity(
        self, model: PreparedModel, photograph: PreparedPhotograph, *, fine: bool = False
    ) -> Similarity:
        template = photograph.fine if fine and self.calibrated else photograph.template(self.problem.similarity)
        similarity = model.similarity(template, detail=DETAIL, camera=photograph.crop.camera)
        self._similarities.append(similarity)
        return similarity
