"""The operator's steps as native loops for CPUs: the same results up to rounding, and the same derivatives.

``docs/kernels.md`` explains them; ``tests/hog/kernels`` compares them with the reference steps.
"""
