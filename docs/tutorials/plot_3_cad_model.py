"""
You have a CAD model
====================

The model of an object and a photograph of it: from where was the photograph taken? This tutorial loads a mesh, renders
it, estimates the pose, draws the similarity over all azimuths, and shows what can go wrong.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from torch import Tensor

import nablahog
from nablahog.io.images import sample_photograph
from nablahog.paper.scenes import SceneSettings, scene
from nablahog.render import PARAMETERS, Mesh, depth_and_normals, pose, silhouette

# %%
# Load a mesh
# -----------
# OFF, OBJ, PLY, STL, GLB and glTF files can be loaded. For this tutorial, a procedural chair is written as an OBJ file,
# with y up, as in most OBJ files.

folder = tempfile.TemporaryDirectory()
path = Path(folder.name) / "chair.obj"
original = nablahog.sample_chairs()["wooden-1"]
lines = [f"v {x:.6f} {z:.6f} {-y:.6f}" for x, y, z in original.vertices.tolist()]
lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in original.faces.tolist()]
path.write_text("\n".join(lines))

mesh = nablahog.load_mesh(path)
print(mesh)
extent = mesh.vertices.amax(0) - mesh.vertices.amin(0)
print(f"bounding box {extent.numpy().round(2)}, its diagonal is {float(extent.norm()):.3f}")

# %%
# A loaded mesh is normalised: its box is centred at 0, and the diagonal is 1. z is up and the front looks to −y.
#
# Look before you search
# ----------------------
# Wrong axes are the most frequent mistake. Azimuth 0 must show the front, 90 the object's left side. If not, pass the
# axes of the file: ``load_mesh(path, up="z", front="-y")``.

camera = nablahog.Camera.from_field_of_view(30, height=96, width=96)
renderer = nablahog.Renderer(mesh, camera)
azimuths = (0, 45, 90, 180, 270)
figure, panels = plt.subplots(2, 5, figsize=(10, 4.4), layout="constrained")
wrong_axes = nablahog.Renderer(nablahog.load_mesh(path, up="z", front="-y"), camera)
for k, azimuth in enumerate(azimuths):
    view = pose(azimuth, elevation=15, distance=2.4)
    for axes, each in zip(panels[:, k], (renderer, wrong_axes), strict=True):
        axes.imshow(each(view)[0, 0], cmap="gray", vmin=0, vmax=1)
        axes.set_axis_off()
    panels[0, k].set_title(f"azimuth {azimuth}°", fontsize=10)
    panels[1, k].set_title('up="z": wrong' if k == 0 else "", fontsize=10)
plt.show()

# %%
# A rendering is more than its brightness
# ---------------------------------------

view = pose(35, elevation=20, distance=2.3)
depth, normals = depth_and_normals(mesh, view, camera)
tangent = torch.zeros_like(view)
tangent[0, 0] = 1
by_azimuth = torch.func.jvp(renderer, (view,), (tangent,))[1]
figure, panels = plt.subplots(1, 5, figsize=(12, 3), layout="constrained")
depth_shown = np.where(np.isfinite(depth[0].numpy()), depth[0].numpy(), np.nan)
for axes, picture, title, colours in zip(
    panels,
    (renderer(view)[0, 0], silhouette(mesh, view, camera)[0, 0], depth_shown, normals[0].permute(1, 2, 0) / 2 + 0.5),
    (
        "brightness",
        "coverage, 0…1",
        f"depth, {np.nanmin(depth_shown):.1f} … {np.nanmax(depth_shown):.1f} units",
        "normals, x y z as R G B",
    ),
    ("gray", "gray", "viridis_r", None),
    strict=False,
):
    axes.imshow(picture, cmap=colours)
    axes.set_title(title, fontsize=10)
panels[4].imshow(by_azimuth[0, 0], cmap="RdBu", vmin=-0.3, vmax=0.3)
panels[4].set_title("derivative by azimuth,\n±0.3 per degree", fontsize=10)
for axes in panels:
    axes.set_axis_off()
plt.show()

# %%
# Estimate a pose
# ---------------
# The "photograph" is a rendering of the chair at a known pose in front of a photograph, with random light, colour, blur
# and noise. ``estimate_pose`` takes the photograph, the mesh, the box around the object, and the rough elevation, if it
# is known.

settings = SceneSettings(occlusion=0)
truth = np.array([[35.0, 15.0, 0.0]])
one = scene(0, {"chair": mesh}, truth, [sample_photograph("chelsea")], seed=2, settings=settings)
estimate = nablahog.estimate_pose(one.image, mesh, box=one.box, initial=(0, 10))
print(estimate)
for name, value in zip(PARAMETERS, one.pose.tolist(), strict=True):
    print(f"{name:9} true {value:7.2f}, estimated {getattr(estimate, name):7.2f}")

# %%
# The distance depends on the camera's lens, and one photograph of an object says little about the lens. The estimate
# assumes a lens, that of ``estimate.camera``, so the two distances cannot be compared. Look at the outline instead:
# does it fit the object?


def outline(axes: Axes, mesh: Mesh, estimate: nablahog.PoseEstimate, photograph: Tensor) -> None:
    """Draws the outline of a mesh at its estimated pose on the photograph."""
    axes.imshow(photograph.permute(1, 2, 0))
    inside = silhouette(mesh, estimate.pose, estimate.camera)[0, 0]
    axes.contour(inside, levels=[0.5], colors="red", linewidths=1.5)
    axes.set_axis_off()


# %%
# The similarity over all azimuths
# --------------------------------
# ``estimate_pose`` uses a calibrated similarity. A simpler one needs only a few public functions: the cosine between
# the HOG of the photograph's box and the HOG of renderings. The renderings have the estimated pose, except for the
# azimuth. One backward pass gives the derivatives with respect to all azimuths.

x0, y0, x1, y1 = (round(side) for side in one.box)
spec = nablahog.presets.uoctti(cell_size=8)
in_photograph = nablahog.Renderer(mesh, estimate.camera)


def descriptors(images: Tensor) -> Tensor:
    """HOG of the box in images (B, C, H, W), in one row each."""
    return nablahog.hog(images[:, :, y0:y1, x0:x1], spec).flatten(1)


around = torch.arange(0.0, 360.0, 4.0, dtype=torch.float64).requires_grad_()
poses = torch.cat([around[:, None], estimate.pose[:, 1:].expand(len(around), 5)], dim=1)
similarities = torch.nn.functional.cosine_similarity(descriptors(in_photograph(poses)), descriptors(one.image[None]))
(derivatives,) = torch.autograd.grad(similarities.sum(), around)

figure = plt.figure(figsize=(11, 4), layout="constrained")
grid = figure.add_gridspec(2, 2, width_ratios=[1, 1.9], height_ratios=[3, 2])
left, top, low = (figure.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1]))
outline(left, mesh, estimate, one.image)
left.set_title(f"estimated azimuth {estimate.azimuth:.1f}°, true {truth[0, 0]:.0f}°", fontsize=10)
for axes, values, label in ((top, similarities, "similarity, a cosine"), (low, derivatives, "derivative, 1/°")):
    axes.plot(around.detach(), values.detach())
    axes.axvline(truth[0, 0], color="tab:red", label="true azimuth")
    axes.set(ylabel=label, xlim=(0, 360), xticks=range(0, 361, 45))
low.axhline(0, color="black", linewidth=0.5)
low.set_xlabel("azimuth in degrees")
top.legend(fontsize=9)
plt.show()

# %%
# The similarity has a maximum on each side of the object, and only one is right. The derivative is jagged, because the
# descriptor changes whenever an edge passes a sample of a pixel. A search that follows it needs many starts, or means
# over some degrees. More on this: :ref:`sphx_glr_auto_gallery_plot_pose_similarity.py`.
#
# What can go wrong
# -----------------
# The same photograph, with one mistake at a time. The unit of the similarity is its standard deviation over arbitrary
# photographs. ``nablahog pose`` warns if it is no larger than in photographs without the object. Look at the outline in
# any case.

wide, high = one.box.width, one.box.height
other = nablahog.sample_chairs()["office-0"]
attempts: dict[str, tuple[Mesh, tuple[float, float, float, float], tuple[float, float]]] = {
    "all right": (mesh, one.box, (0.0, 10.0)),
    "box 1.6 times too large": (
        mesh,
        (one.box.x0 - 0.3 * wide, one.box.y0 - 0.3 * high, one.box.x1 + 0.3 * wide, one.box.y1 + 0.3 * high),
        (0.0, 10.0),
    ),
    "box of half the object": (mesh, (one.box.x0, one.box.y0, one.box.x1, one.box.y0 + high / 2), (0.0, 10.0)),
    "elevation 50° instead of 15°": (mesh, one.box, (0.0, 50.0)),
    "axes of the mesh wrong": (nablahog.load_mesh(path, up="z", front="-y"), one.box, (0.0, 10.0)),
    "another chair's model": (other, one.box, (0.0, 10.0)),
}
figure, panels = plt.subplots(2, 3, figsize=(10, 7.2), layout="constrained")
for axes, (what, (model, box, initial)) in zip(panels.flat, attempts.items(), strict=True):
    attempt = nablahog.estimate_pose(one.image, model, box=box, initial=initial)
    outline(axes, model, attempt, one.image)
    x, y, right, bottom = box
    axes.add_patch(Rectangle((x, y), right - x, bottom - y, fill=False, edgecolor="cyan"))
    error = float(nablahog.metrics.azimuth_error(attempt.azimuth, truth[0, 0]))
    axes.set_title(f"{what}:\noff by {error:.0f}°, similarity {attempt.similarity:.1f}", fontsize=10)
plt.show()
folder.cleanup()

# %%
# How often estimates are right, for each kind of search, and what the paper leaves open: :doc:`/poses`. If you have
# several models, pass all of them in a dictionary: the estimate names the best one.
