"""
The pose of a chair in a photograph
===================================

You have a photograph, a box around the object, and a CAD model of it. From where does the camera see it?
``estimate_pose`` searches the azimuth, elevation, in-plane rotation, distance and place at which a rendering of the
model has the HOG most like the photograph's.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

import nablahog
from nablahog.io.images import SAMPLE_NAMES, sample_photograph
from nablahog.paper.scenes import scene
from nablahog.render import silhouette

# %%
# A scene whose pose is known
# ---------------------------
# A procedural chair is put in front of a photograph, with random light, colour, blur and noise. ``scene`` also
# gives a box with the error of an annotation. Your own photograph is an array (H, W, 3) or a PIL image, the model is
# ``nablahog.load_mesh("chair.obj")``.

chairs = dict(list(nablahog.sample_chairs().items())[:6])
viewpoints = np.array([[[35.0, 15, 0]], [[140, 25, 3]], [[320, 20, -2]]])  # azimuth, elevation, theta of each scene
clutter = [sample_photograph(name) for name in SAMPLE_NAMES]
scenes = [scene(k, chairs, viewpoints[k], clutter, seed=6) for k in range(3)]

# %%
# Search
# ------
# The elevation is known roughly, the azimuth not at all. Each estimate takes about a second.

estimates = [
    nablahog.estimate_pose(each.image, chairs[each.model], box=each.box, initial=(0, float(each.initial[1])))
    for each in scenes
]
for each, estimate in zip(scenes, estimates, strict=True):
    azimuth, elevation = each.pose[:2].tolist()
    print(estimate)
    error = float(nablahog.metrics.azimuth_error(estimate.azimuth, azimuth))
    print(f"    true azimuth {azimuth:.1f}°, elevation {elevation:.1f}°: the azimuth is off by {error:.1f}°")

# %%
# Look at the results
# -------------------
# The outline of the model at the estimated pose, and its rendering. ``estimate.camera`` sees the whole photograph.

figure, panels = plt.subplots(2, 3, figsize=(9, 6.3), layout="constrained")
for (above, below), each, estimate in zip(panels.T, scenes, estimates, strict=True):
    above.imshow(each.image.permute(1, 2, 0))
    x0, y0, x1, y1 = each.box
    above.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, edgecolor="cyan", linewidth=1))
    inside = silhouette(chairs[each.model], estimate.pose, estimate.camera)
    above.contour(np.asarray(inside).reshape(inside.shape[-2:]), levels=[0.5], colors="red", linewidths=1.2)
    above.set_title(f"{each.model}, true azimuth {float(each.pose[0]):.0f}°", fontsize=10)
    rendering = nablahog.render(chairs[each.model], estimate.pose, estimate.camera)
    below.imshow(rendering[0, 0], cmap="gray", vmin=0, vmax=1)
    below.set_title(f"azimuth {estimate.azimuth:.1f}°, similarity {estimate.similarity:.1f}", fontsize=10)
for axes in panels.flat:
    axes.set_axis_off()
plt.show()

# %%
# Cyan: the given box. Red: the outline of the rendering below. The similarity is that of the rendering's own linear
# discriminant to the photograph, in standard deviations over arbitrary photographs.
#
# Which model?
# ------------
# With several models the best one is returned, too. Here all six are candidates.

estimate = nablahog.estimate_pose(scenes[0].image, chairs, box=scenes[0].box, initial=(0, float(scenes[0].initial[1])))
print(f"true model: {scenes[0].model}, estimate: {estimate.model}, azimuth {estimate.azimuth:.1f}°")
