"""Similarity of two images (CC, MI, SSIM, PSNR), and errors of viewpoints."""

from ..runtime.stubs import attach

__getattr__, __dir__, __all__ = attach(__name__)
