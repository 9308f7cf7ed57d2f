"""The steps of rendering for a rigid object on a CPU as compiled loops: one pass each over triangles, edges, samples.

They return what the plain steps return, up to rounding; ``tests/render/test_kernels.py`` holds both side by side.
"""
