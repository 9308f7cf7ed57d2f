"""
Fit a pose by gradient ascent in plain PyTorch
==============================================

The renderer and the HOG are differentiable operators, so that an optimiser of PyTorch can turn a model until its HOG is
like a given one. Here is all of it in one loop.
"""

import matplotlib.pyplot as plt
import torch
from torch.nn.functional import cosine_similarity

import nablahog

# %%
# What is known: a descriptor
# ---------------------------

mesh = nablahog.sample_chairs()["wooden-0"]  # or nablahog.load_mesh("chair.obj")
camera = nablahog.Camera.from_field_of_view(30, 128, 128)
renderer = nablahog.Renderer(mesh, camera)
spec = nablahog.presets.uoctti(cell_size=8)

# azimuth, elevation in degrees; distance in units of the mesh; in-plane angle in degrees; shift in pixels
true = torch.tensor([[40.0, 20.0, 2.2, 0.0, 0.0, 0.0]])
descriptor = nablahog.hog(renderer(true), spec).flatten()

# %%
# The loop
# --------
# The six parameters have different units. One step of the optimiser changes all of them alike, so they are scaled: ten
# degrees of azimuth and elevation are worth a tenth of a unit of distance.

start = true + torch.tensor([[25.0, -10.0, 0.3, 0.0, 0.0, 0.0]])
units = torch.tensor([[10.0, 10.0, 0.1, 1.0, 1.0, 1.0]])
change = torch.zeros_like(start, requires_grad=True)
optimizer = torch.optim.Adam([change], lr=0.3)
schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, 60)
path, similarities = [], []
for step in range(61):
    pose = start + units * change
    similarity = cosine_similarity(nablahog.hog(renderer(pose), spec).flatten(), descriptor, dim=0)
    optimizer.zero_grad()
    (-similarity).backward()
    optimizer.step()
    schedule.step()
    path.append(pose.detach()[0])
    similarities.append(float(similarity.detach()))
    if step % 10 == 0:
        azimuth, elevation, distance = path[-1][:3].tolist()
        print(f"step {step:2}: similarity {similarities[-1]:.4f}, azimuth {azimuth:.1f}°, ", end="")
        print(f"elevation {elevation:.1f}°, distance {distance:.3f}")

# %%
# What happened
# -------------

figure, panels = plt.subplots(1, 4, figsize=(12, 3.2), width_ratios=[1, 1, 1, 1.5], layout="constrained")
goal = renderer(true)[0, 0]
for axes, k in zip(panels, (0, 10, 60), strict=False):
    picture = renderer(path[k][None])[0, 0]
    axes.imshow(torch.stack([picture, goal, goal], dim=2))
    axes.set_title(f"step {k}: similarity {similarities[k]:.3f}", fontsize=10)
    axes.set_axis_off()
errors = torch.stack(path) - true
for k, name in enumerate(("azimuth, °", "elevation, °")):
    panels[3].plot(errors[:, k], label=name)
panels[3].plot(100 * errors[:, 2], label="distance, 0.01 units")
panels[3].axhline(0, color="black", linewidth=0.5)
panels[3].set(xlabel="steps of Adam", ylabel="error of the pose")
panels[3].legend(fontsize=9)
plt.show()

# %%
# Cyan where only the rendering is dark, red where only the goal is, gray where both agree. From an azimuth on the other
# side the ascent would end at another maximum: see
# :ref:`sphx_glr_auto_gallery_plot_pose_similarity.py`.
