"""One object followed from frame to frame: each pose is searched near that of the frame before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from ..hog.box import Box
from ..hog.inputs import ArrayImage
from ..render import Camera, Mesh
from .ascent import Round, quadratic_ascent
from .confidence import Evidence, confidence
from .crop import ObjectCrop, crop_object, typical_camera
from .estimate import estimate_pose, one_image
from .placement import bounding_boxes
from .pose_estimate import PoseEstimate, estimate_at
from .prepared import DETAIL, PreparedPhotograph, prepared_model

COARSE = (Round(12, 1.0, slopes=False),)
FINE = (Round(12, 0.6, slopes=False), Round(12, 0.6, slopes=False))
"""Of each frame.  Values alone: in the same time they are off by less (``benchmarks/tracking.py``)."""
STRIDES = (0.0, 0.5, 1.0)  # of the motion between the last two frames, after which the ascent may start
LEAST = 4.5  # similarity from which on the object counts as seen
LEAST_SHARE = 0.5  # of the usual similarity, likewise
FADE = 0.9  # of the usual similarity that remains after a frame
NEAREST, LARGEST = 1.0, 2.0  # distance in diagonals of the mesh, and size as a part of the frame, that are followed
SURE = 0.5  # confidence with which a search must find the object
SEARCH_EVERY = 5  # frames without the object, from one search in the whole frame to the next


class Tracker:
    """Follows an object through the frames of a video.

    The first frame is searched as :func:`.estimate.estimate_pose` does.  In later ones a crop follows the object, and a
    few rounds of :func:`.ascent.quadratic_ascent` start from the pose of the frame before, or from where it would be if
    it moved on.  An object that looks much less like the model than before is lost; it is looked for near its last pose
    in every frame, and in the whole of every fifth, which takes longer.

    Args:
        mesh: of the object, normalised.
        focal, principal_point: of the camera, as :func:`.estimate.estimate_pose` takes them; an unknown focal length is
            assumed in the first frame and kept.
        box: x0, y0, x1, y1 of the object in the first frame, pixels; by default it may be anywhere.
        initial: azimuth and elevation in the first frame, degrees; by default unknown.
        seed: of what is sampled.

    Attributes:
        lost: frames since the object was seen last; 0 while it is seen.

    >>> mesh, camera = nablahog.sample_chairs()["wooden-0"], nablahog.Camera.from_field_of_view(30, 128, 128)
    >>> poses = torch.tensor([[azimuth, 20.0, 2, 0, 0, 0] for azimuth in (30, 32, 34)])
    >>> tracker = nablahog.pose.Tracker(mesh, box=(28, 12, 95, 125))
    >>> estimates = [tracker(frame) for frame in nablahog.render(mesh, poses, camera)]
    >>> [28 < estimate.azimuth < 36 for estimate in estimates]
    [True, True, True]
    """

    def __init__(
        self,
        mesh: Mesh,
        *,
        focal: float | None = None,
        principal_point: Sequence[float] | None = None,
        box: Sequence[float] | None = None,
        initial: Sequence[float] | None = None,
        seed: int = 0,
    ) -> None:
        self.mesh, self.model, self.seed = mesh, prepared_model(mesh, typical_camera()), seed
        self.focal, self.principal_point = focal, principal_point
        self.box, self.initial = box, initial
        self.lost = 0
        self._generator = torch.Generator().manual_seed(seed)
        self._last: PoseEstimate | None = None
        self._motion = torch.zeros(6, dtype=torch.float64)
        self._usual = self._rival = 0.0

    def __call__(self, frame: Tensor | ArrayImage) -> PoseEstimate | None:
        """The pose in the next frame; None where the object is not seen.

        Args:
            frame: a photograph as :func:`.estimate.estimate_pose` takes it; all frames have one size.

        Raises:
            ValueError: the frame, or an option, is none of what :func:`.estimate.estimate_pose` takes.
        """
        image = one_image(frame)
        estimate = None if self._last is None else self._follow(image, self._last)
        if estimate is None and (self.lost + (self._last is not None)) % SEARCH_EVERY == 0:
            estimate = self._search(image)
        if estimate is None:
            self.lost += 1
            return None
        if self._last is None or self.lost:
            self._motion = torch.zeros_like(self._motion)
        else:
            self._motion = estimate.pose[0] - self._last.pose[0]
            self._motion[0] = (self._motion[0] + 180) % 360 - 180
        self._usual = FADE * self._usual + (1 - FADE) * estimate.similarity if self._usual else estimate.similarity
        self._last, self.lost = estimate, 0
        return estimate

    def _follow(self, image: Tensor, last: PoseEstimate) -> PoseEstimate | None:
        """The pose near the last one; None if the object is not there."""
        size = image.shape[1:]
        starts = last.pose + torch.tensor(STRIDES, dtype=torch.float64)[:, None] * self._motion
        crop = self._crop(image, starts[-1], last)
        if crop is None:
            return None
        photograph = PreparedPhotograph(crop)
        coarse, fine = (
            self.model.similarity(template, detail=DETAIL, camera=crop.camera)
            for template in (photograph.calibrated, photograph.fine)
        )
        of_crop = torch.stack([crop.of_photograph(start, *size) for start in starts])
        start = of_crop[coarse.values(of_crop).argmax()]
        pose = quadratic_ascent(coarse, start, COARSE, self._generator)
        pose = quadratic_ascent(fine, pose, FINE, self._generator)
        value = float(fine.values(pose[None]))
        if value < max(LEAST, LEAST_SHARE * self._usual):
            return None
        return self._estimate(crop, pose, value, last, coarse.renderings + fine.renderings, size)

    def _crop(self, image: Tensor, pose: Tensor, last: PoseEstimate) -> ObjectCrop | None:
        """Around where the object is expected; None if that is beside the frame, or larger than it."""
        box = self._box(pose, last.camera)
        if pose[2] < NEAREST or max(box.width, box.height) > LARGEST * max(image.shape[1:]):
            return None
        try:
            return crop_object(image, box, focal=last.camera.focal, axis=last.principal_point)
        except ValueError:
            return None

    def _box(self, pose: Tensor, camera: Camera) -> Box:
        (sides,) = bounding_boxes(pose[None], self.model.hull, camera)
        middle = torch.tensor([camera.width / 2, camera.height / 2] * 2)
        return Box.of((sides + middle).tolist())

    def _estimate(
        self, crop: ObjectCrop, pose: Tensor, value: float, last: PoseEstimate, renderings: int, size: torch.Size
    ) -> PoseEstimate:
        moved, camera = crop.in_photograph(pose, *size)
        return estimate_at(
            moved,
            camera,
            model="",
            similarity=value,
            similarity_kind="calibrated",
            crop_pose=pose,
            renderings=renderings,
            box=self._box(moved, camera),
            confidence=confidence(Evidence(value, self._rival, 1.0), known_model=True),
            equivalent_azimuths=last.equivalent_azimuths,
            focal_from=last.focal_from,
            principal_point=last.principal_point,
            from_original=self.mesh.from_original,
        )

    def _search(self, image: Tensor) -> PoseEstimate | None:
        """The pose anywhere in the frame; None if the object is not found."""
        first = self._last is None
        estimate = estimate_pose(
            image,
            self.mesh,
            box=self.box if first else None,
            initial=self.initial if first else None,
            focal=self.focal,
            principal_point=self.principal_point,
            seed=self.seed,
        )
        if estimate.confidence is None or estimate.confidence < SURE:
            return None
        if self._last is not None and self.focal is None:  # the lens is that of the first frame
            longer = self._last.camera.focal / estimate.camera.focal
            estimate = replace(estimate, camera=self._last.camera, distance=longer * estimate.distance)
        self._rival = max((one.share for one in estimate.runners_up), default=0.0)
        self._motion = torch.zeros_like(self._motion)
        return self._follow(image, estimate)
