"""The pose of an object by gradient ascent: a chair is rendered, its HOG is all that is known, the pose is found again.

python examples/render_and_fit.py --mesh chair.obj --out render_and_fit.png
"""

import argparse
from collections.abc import Sequence

import numpy as np
import torch
from PIL import Image
from torch.nn.functional import cosine_similarity

import nablahog


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mesh", help="OFF, OBJ, PLY, STL or GLB; by default a chair that a program makes")
    parser.add_argument("--out", default="render_and_fit.png", help="the picture to write")
    parser.add_argument("--size", type=int, default=128, help="pixels of a side of the renderings")
    parser.add_argument("--steps", type=int, default=60)
    arguments = parser.parse_args(argv)

    mesh = nablahog.load_mesh(arguments.mesh) if arguments.mesh else nablahog.datasets.chairs.chair(3)
    camera = nablahog.Camera.from_field_of_view(30, arguments.size, arguments.size)
    renderer = nablahog.Renderer(mesh, camera)
    spec = nablahog.presets.uoctti(cell_size=8)

    # azimuth, elevation in degrees; distance in units of the mesh; in-plane angle; shift in pixels
    true = torch.tensor([[40.0, 20.0, 2.2, 0.0, 0.0, 0.0]])
    start = true + torch.tensor([[25.0, -10.0, 0.3, 0.0, 0.0, 0.0]])
    units = torch.tensor([[10.0, 10.0, 0.1, 1.0, 1.0, 1.0]])  # one step of the minimiser changes all parameters alike
    photograph = nablahog.hog(renderer(true), spec)

    change = torch.zeros_like(start, requires_grad=True)
    optimizer = torch.optim.Adam([change], lr=0.3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, arguments.steps)
    for step in range(arguments.steps + 1):
        pose = start + units * change
        similarity = cosine_similarity(nablahog.hog(renderer(pose), spec).flatten(), photograph.flatten(), dim=0)
        optimizer.zero_grad()
        (-similarity).backward()
        optimizer.step()
        schedule.step()
        if step % 10 == 0:
            azimuth, elevation, distance = pose[0, :3].tolist()
            print(f"step {step:3}: similarity {similarity.item():.4f}, azimuth {azimuth:6.2f}°, ", end="")
            print(f"elevation {elevation:5.2f}°, distance {distance:.3f}")

    pictures = [renderer(poses)[0, 0].detach().numpy() for poses in (true, start, pose)]
    pictures += [(pictures[k] - pictures[0]) / 2 + 0.5 for k in (1, 2)]  # gray where they agree
    Image.fromarray(np.uint8(255 * np.hstack(pictures))).save(arguments.out)


if __name__ == "__main__":
    main()
