"""Renderings and poses."""

from __future__ import annotations

from typing import Any

import torch

import nablahog
from nablahog import Camera, Renderer, render
from nablahog.render import depth_and_normals, pose, silhouette

from ..table import Use, column
from .plain import BATCH, BOX, CAMERA, IMAGE, MASK, MESH, POSES, angle, image, number


def fitted(photograph: Any, models: Any = MESH, **more: Any) -> Any:
    options: dict[str, Any] = {"box": BOX, "initial": (30, 20), "method": "exhaustive", **more}
    found = nablahog.estimate_pose(photograph, models, **options)
    return found.azimuth, found.elevation, found.distance, found.theta, found.x, found.y


def as_intrinsics(camera: Any) -> Any:
    return (camera.focal, camera.focal, camera.width / 2, camera.height / 2) if isinstance(camera, Camera) else camera


def drawn(mesh: Any = MESH, poses: Any = POSES, camera: Any = CAMERA, **more: Any) -> Any:
    return render(mesh, poses, camera, **more)


COLUMNS = [
    column(
        "estimate_pose",
        context=image(lambda x: fitted(x, box=None, method="best")),
        image=image(fitted),
        box=Use(lambda b: fitted(IMAGE, box=b), BOX),
        angle=angle(lambda a: fitted(IMAGE, initial=(a, 20), method="best"), 30.0),
        number=number(lambda n: fitted(IMAGE, seed=n, method="best"), 3),
        camera=Use(lambda c: fitted(IMAGE, focal=getattr(c, "focal", c)), CAMERA),
        mask=Use(lambda m: fitted(IMAGE, mask=m), MASK),
        mesh=Use(lambda m: fitted(IMAGE, m), MESH),
        tolerance=0.05,
    ),
    column(
        "estimate_pose intrinsics",
        camera=Use(lambda c: fitted(IMAGE, intrinsics=as_intrinsics(c), distortion=(0, 0, 0, 0)), CAMERA),
        tolerance=0.05,
    ),
    column(
        "render",
        descriptor=Use(lambda p: drawn(poses=p), POSES),  # numbers as other descriptors are
        mesh=Use(lambda m: drawn(m), MESH),
        camera=Use(lambda c: drawn(camera=c), CAMERA),
        batch=Use(lambda x: drawn(background=x), BATCH),
        angle=angle(lambda a: drawn(background=a), 1.0),
        number=number(lambda n: drawn(supersampling=n), 2),
        tolerance=1e-4,
        traceable=True,
        types=(torch.Tensor,),
    ),
    column(
        "Renderer.render",
        descriptor=Use(lambda p: Renderer(MESH, CAMERA).render(p, derivative=False).image, POSES),
        tolerance=1e-4,
        types=(torch.Tensor,),
    ),
    column(
        "silhouette",
        mesh=Use(lambda m: silhouette(m, POSES, CAMERA), MESH),
        camera=Use(lambda c: silhouette(MESH, POSES, c), CAMERA),
        tolerance=1e-4,
    ),
    column("depth_and_normals", mesh=Use(lambda m: depth_and_normals(m, POSES, CAMERA)[1], MESH), tolerance=1e-4),
    column("pose", angle=angle(lambda a: drawn(poses=pose(azimuth=a, distance=2)), 30.0), tolerance=1e-4),
    column(
        "Camera",
        angle=angle(lambda a: drawn(camera=Camera.from_field_of_view(a, 48, 40)), 30.0),
        tolerance=1e-4,
    ),
]
