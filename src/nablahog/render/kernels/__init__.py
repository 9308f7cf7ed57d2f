"""Rendering a rigid object on a CPU in compiled loops: one pass each over triangles, edges and samples.

They return what :mod:`..pipeline` returns, up to rounding; ``tests/render/kernels`` compares the two.
"""
