"""Section 3.1: descriptor to pre-image."""

from .preimage import Reconstruction, reconstruct

__all__ = ["Reconstruction", "reconstruct"]
