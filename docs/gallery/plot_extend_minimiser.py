"""
Your own minimiser
==================

Two minimisers come with the package. A third one is a function from an objective and starting points to a ``Minimum``.
Here it is Nesterov's accelerated gradient, compared with the others on the same problem: the pre-image of a HOG.
"""

import matplotlib.pyplot as plt
import numpy as np
import torch
from PIL import Image
from skimage import data
from torch import Tensor

import nablahog
from nablahog.optimize import lbfgs
from nablahog.optimize.problems import Minimum, ObjectiveFunction, Running, StopReason, Watch

# %%
# The method
# ----------
# Rows of ``start`` are independent problems, each with its own step size, its own lowest point and its own end.
# ``Running`` counts their evaluations, calls ``watch``, and says which rows go on when some have ended. On a GPU rows
# that have ended stay for a few rounds: with a step of 0 they are evaluated again where they are.


def nesterov(
    objective: ObjectiveFunction,
    start: Tensor,
    *,
    share: float = 0.9,
    first_step: float = 1.0,
    max_evaluations: int = 300,
    gradient_tolerance: float = 0.0,
    progress_tolerance: float = 0.0,
    watch: Watch | None = None,
) -> Minimum:
    """Nesterov's accelerated gradient, (B, N) unknowns: the velocity v ← s·v − g, the displacement s·v − g.

    A step grows by 5 % after each new lowest point; after five evaluations without one, or where the objective is not
    finite, it is halved, and the search goes on from the lowest point.
    """
    x = best = start
    value, gradient = objective(start, torch.arange(len(start), device=start.device))
    lowest, of_best = value, gradient
    velocity, waited = torch.zeros_like(x), torch.zeros_like(value)
    step = first_step / gradient.norm(dim=1).clamp_min(torch.finfo(x.dtype).tiny)
    running = Running(start, lowest, watch)
    for _ in range(max_evaluations - 1):
        velocity = share * velocity - gradient
        x = x + step[:, None] * (share * velocity - gradient)
        value, gradient = objective(x, running.index)
        lower = value < lowest
        lowest = torch.where(lower, value, lowest)
        best = torch.where(lower[:, None], x, best)
        of_best = torch.where(lower[:, None], gradient, of_best)
        waited = torch.where(lower, 0, waited + 1) % 5
        restart = ~lower & ((waited == 0) | ~value.isfinite())
        step = torch.where(lower, 1.05 * step, torch.where(restart, step / 2, step))
        x = torch.where(restart[:, None], best, x)
        gradient = torch.where(restart[:, None], of_best, gradient)
        velocity = torch.where(restart[:, None], 0, velocity)
        running.count(lowest)
        peak = of_best.abs().amax(dim=1)
        moves = step * peak > torch.finfo(x.dtype).eps * best.abs().amax(dim=1)  # False of NaN
        running.end(
            {
                StopReason.GRADIENT: peak <= gradient_tolerance,
                StopReason.PROGRESS: running.find_stalled(progress_tolerance),
                StopReason.LINE_SEARCH: ~moves,
            }
        )
        step = torch.where(running.codes == 0, step, 0)
        rows = running.look(best, lowest)
        if rows is not None:
            x, best, gradient, of_best, velocity = (v[rows] for v in (x, best, gradient, of_best, velocity))
            lowest, step, waited = lowest[rows], step[rows], waited[rows]
            if not len(rows):
                break
    return running.minimum(best, lowest)


# %%
# The problem
# -----------
# The objective is the squared relative distance of descriptors; the search begins at gray with a little noise. The
# unknowns are logits of the pixels, so that an image stays in 0…1. The arguments of an objective are the points of the
# problems that are still running, and the indices of these problems in the batch.

SIDE = 64
names = {"astronaut": (90, 0, 346, 256), "coffee": (150, 20, 500, 370), "chelsea": (60, 10, 340, 290)}
pictures = [Image.fromarray(getattr(data, name)()).convert("L").crop(box) for name, box in names.items()]
photographs = torch.from_numpy(np.stack([np.array(picture.resize((SIDE, SIDE))) for picture in pictures]))[:, None]
spec = nablahog.presets.uoctti(cell_size=8)
descriptors = nablahog.hog(photographs, spec)


def objective(points: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
    """(A, N) logits of the problems ``index`` (A,) to values (A,) and gradients (A, N)."""
    target = descriptors[index]
    with torch.enable_grad():
        points = points.detach().requires_grad_()
        difference = nablahog.hog(points.sigmoid().reshape(-1, 1, SIDE, SIDE), spec) - target
        values = difference.square().sum((1, 2, 3)) / target.square().sum((1, 2, 3))
        (gradients,) = torch.autograd.grad(values.sum(), points)
    return values.detach(), gradients


# %%
# Comparison
# ----------

torch.manual_seed(0)
start = 0.2 * torch.randn(len(photographs), SIDE**2)
BUDGET = 300
minima = {"nesterov": nesterov(objective, start, max_evaluations=BUDGET)}
minima["lbfgs"] = lbfgs(objective, start, max_evaluations=BUDGET)

figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
for name, minimum in minima.items():
    lowest = minimum.history.cummin(dim=0).values.sqrt().mean(dim=1)
    axes.plot(range(1, len(lowest) + 1), lowest, label=f"{name}: {lowest[-1]:.3f} at last")
axes.set(
    yscale="log",
    xlabel="evaluations of the objective, one value with its gradient each",
    ylabel="lowest relative distance so far,\nmean of three photographs",
)
axes.legend()
plt.show()

# %%

figure, panels = plt.subplots(3, 3, figsize=(6, 6), layout="constrained")
columns = {
    "photograph": photographs[:, 0],
    **{name: m.x.sigmoid().reshape(-1, SIDE, SIDE) for name, m in minima.items()},
}
for col, (name, images) in zip(panels.T, columns.items(), strict=True):
    for axes, picture in zip(col, images, strict=True):
        axes.imshow(picture, cmap="gray")
        axes.set_axis_off()
    col[0].set_title(name, fontsize=10)
plt.show()

# %%
# Both explain the descriptor, and both are grainy: what the descriptor does not determine remains noise. How
# ``reconstruct`` avoids this: :doc:`/reconstruction`.
#
# To use it in ``reconstruct`` as ``Search(minimiser="nesterov")``, copy the function as it is, with its imports, into
# ``src/nablahog/optimize/nesterov.py`` and run ``make generated``, as :doc:`/contributing` says.
