"""Brightness of samples: perspective-correct interpolation between the corners of a triangle."""

from __future__ import annotations

import numpy as np

from ...runtime.compile import compiled, inlined
from .arrays import Floats, MeshArrays, Pixels, Samples


@compiled
def shade(screen: Floats, mesh: MeshArrays, pixels: Pixels, gradients: Floats, samples: Samples) -> None:
    """Writes the brightness of each sample to ``samples.brightness``.

    Args:
        screen: (V, 3), as for :func:`.rasterize.rasterize`.
        mesh: its faces, and the brightness at their corners.
        pixels: whose image holds the background, and whose box ``samples`` are of.
        gradients: (F, 7), scratch.
        samples: rasterised.
    """
    real = screen.dtype.type
    background, _, corner, step = pixels
    computed = np.zeros(mesh.faces.shape[0], np.uint8)
    ids, inverse, brightness = samples.ids, samples.inverse, samples.brightness
    for i in range(brightness.shape[0]):
        row = np.uintp(i)
        for pixel in range(brightness.shape[1] // step):
            behind = background[corner[0] + i // step, corner[1] + pixel]
            for j in range(pixel * step, pixel * step + step):
                col = np.uintp(j)
                f = ids[row, col]
                if f < 0:
                    brightness[row, col] = behind
                    continue
                plane = gradients[np.uintp(f)]
                if not computed[np.uintp(f)]:
                    computed[np.uintp(f)] = 1
                    _brightness_gradient(screen, mesh, f, plane)
                across, down = real(j) - plane[2], real(i) - plane[3]
                value = plane[4] + (plane[0] * across + plane[1] * down) / inverse[row, col]
                brightness[row, col] = min(max(value, plane[5]), plane[6])


@inlined
def _brightness_gradient(screen: Floats, mesh: MeshArrays, f: int, plane: Floats) -> None:
    """Writes to ``plane`` (7,) how brightness varies in the face ``f``.

    [0], [1]: derivative of (brightness - that of the first corner) / depth along x and y, constant on the screen;
    [2], [3], [4]: x and y of the first corner, less half a sample, and its brightness; [5], [6]: least and largest
    brightness of the corners.
    """
    half = screen.dtype.type(0.5)
    a, b, c = np.uintp(mesh.faces[f, 0]), np.uintp(mesh.faces[f, 1]), np.uintp(mesh.faces[f, 2])
    va, vb, vc = mesh.brightness[f, 0], mesh.brightness[f, 1], mesh.brightness[f, 2]
    x, y = screen[a, 0], screen[a, 1]
    xb, yb, xc, yc = screen[b, 0] - x, screen[b, 1] - y, screen[c, 0] - x, screen[c, 1] - y
    qb, qc = (vb - va) * screen[b, 2], (vc - va) * screen[c, 2]
    area = xb * yc - xc * yb
    plane[0], plane[1] = (qb * yc - qc * yb) / area, (xb * qc - xc * qb) / area
    plane[2], plane[3], plane[4] = x - half, y - half, va
    plane[5], plane[6] = min(va, vb, vc), max(va, vb, vc)
