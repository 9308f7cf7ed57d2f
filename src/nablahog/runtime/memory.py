"""The memory that work may take on a device."""

from __future__ import annotations

import torch


def memory_for(device: torch.device, on_cpu: int, share: float) -> int:
    """Bytes that one part of a batch may take.

    Asked once for a batch, not in a loop: the driver is slow to answer.

    Args:
        device: where it is to be.
        on_cpu: bytes on anything but a CUDA device: more would leave the caches without a gain.
        share: 0…1, of what is free on a CUDA device; what PyTorch keeps there without use counts as free.
    """
    if device.type != "cuda":
        return on_cpu
    free, _ = torch.cuda.mem_get_info(device)
    unused = torch.cuda.memory_reserved(device) - torch.cuda.memory_allocated(device)
    return int(share * (free + unused))
