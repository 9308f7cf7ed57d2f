"""
Renderings with derivatives
===========================

``nablahog.render`` draws a mesh at a pose. Its derivative by each of the six parameters of the pose is an image, too.
Is it right? Central differences of a rendering with many samples per pixel show it.
"""

import matplotlib.pyplot as plt
import torch
from torch import Tensor
from torch.nn.functional import cosine_similarity

import nablahog
from nablahog.render import PARAMETERS
from nablahog.render.renderer import EdgeMethod

# %%
# A chair and its pose
# --------------------
# Azimuth, elevation and theta are in degrees, the distance is in units of the mesh (a normalised mesh has a diagonal of
# 1), x and y are in pixels.

mesh = nablahog.sample_chairs()["wooden-0"]
camera = nablahog.Camera.from_field_of_view(30, height=96, width=96)
pose = torch.tensor([[40.0, 20.0, 2.3, 0.0, 0.0, 0.0]], dtype=torch.float64)
renderer = nablahog.Renderer(mesh, camera)
print(f"{len(mesh.vertices)} vertices, {len(mesh.faces)} faces; image {tuple(renderer(pose).shape)}")

# %%
# Six derivatives
# ---------------
# Forward mode gives the derivative along one direction of the pose: here along each parameter. The reference is the
# difference quotient of renderings with 16 · 16 samples a pixel, half a degree, 0.01 units or a quarter of a pixel
# ahead and behind.

steps = torch.tensor([0.5, 0.5, 0.01, 0.5, 0.25, 0.25], dtype=torch.float64)
fine = nablahog.Renderer(mesh, camera, supersampling=16)


def along(renderer: nablahog.Renderer, k: int) -> Tensor:
    """The derivative by parameter k (H, W)."""
    tangent = torch.zeros_like(pose)
    tangent[0, k] = 1
    derivative: Tensor = torch.func.jvp(renderer, (pose,), (tangent,))[1]
    return derivative[0, 0]


def difference(k: int) -> Tensor:
    """The central difference of fine renderings (H, W)."""
    step = torch.zeros_like(pose)
    step[0, k] = steps[k]
    return ((fine(pose + step) - fine(pose - step)) / (2 * steps[k]))[0, 0]


figure, panels = plt.subplots(2, 7, figsize=(13, 4.2), layout="constrained")
panels[0, 0].imshow(renderer(pose)[0, 0], cmap="gray", vmin=0, vmax=1)
panels[0, 0].set_title("rendering", fontsize=10)
shown_per = {"azimuth": 2, "elevation": 2, "distance": 0.05, "theta": 1, "x": 0.5, "y": 0.5}
for col, name in enumerate(PARAMETERS):
    derivative, reference = along(renderer, col), difference(col)
    cosine = float(cosine_similarity(derivative.flatten(), reference.flatten(), dim=0))
    for axes, picture in zip(panels[:, col + 1], (derivative, reference), strict=True):
        axes.imshow(picture * shown_per[name], cmap="RdBu", vmin=-0.5, vmax=0.5)
    unit = {"distance": " units", "x": " pixels", "y": " pixels"}.get(name, "°")
    panels[0, col + 1].set_title(f"{name}, {shown_per[name]}{unit}", fontsize=10)
    panels[1, col + 1].set_title(f"cosine {cosine:.3f}", fontsize=10)
panels[1, 0].text(0.5, 0.5, "above: derivative\nbelow: central\ndifference", ha="center", va="center", fontsize=10)
for axes in panels.flat:
    axes.set_axis_off()
plt.show()

# %%
# The first-order change of the image for the named change of the pose: red is darker, blue is brighter, at most half
# of the range from black to white. The cosine of the two images as vectors is 1 if they agree up to a factor.
#
# Two ways to differentiate edges
# -------------------------------
# ``"edges"``, the default, differentiates the area that an edge covers in a pixel. ``"opendr"`` is the paper's
# renderer: minus the difference of neighbouring pixels times the motion of the surface. More samples per pixel
# make both better and slower.

methods: tuple[EdgeMethod, ...] = ("edges", "opendr")
for method in methods:
    for samples in (1, 2, 4):
        other = nablahog.Renderer(mesh, camera, method=method, supersampling=samples)
        of_both = cosine_similarity(along(other, 0).flatten(), difference(0).flatten(), dim=0)
        print(f"{method:6} {samples} x {samples} samples a pixel: cosine {float(of_both):.3f} by azimuth")

# %%
# Reverse mode: a pose that fits
# ------------------------------
# A loss of a rendering has a gradient by the pose. It is what gradient ascent of a pose follows.

target = renderer(pose)
turned = (pose + torch.tensor([[5.0, 0, 0, 0, 0, 0]])).requires_grad_()
(gradient,) = torch.autograd.grad((renderer(turned) - target).square().mean(), turned)
for name, slope in zip(PARAMETERS, gradient[0].tolist(), strict=True):
    print(f"derivative of the mean squared difference by {name:9} {slope:+.5f}")
