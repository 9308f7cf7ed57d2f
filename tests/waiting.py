"""What would wait for a device, found without one: by the operations that are called, and on tensors without numbers.

Tensors on PyTorch's device "meta" have a shape and no numbers.  What runs on them asks for none.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

ASKS = ("_local_scalar_dense", "nonzero", "masked_select", "is_nonzero", "equal", "unique", "_unique", "_unique2")
INDEXES = ("index", "index_put", "index_put_", "_index_put_impl_")


class WithoutWaiting(TorchDispatchMode):
    """Fails where an operation asks a device for numbers, or copies from or to another."""

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        name = function.name().split("::")[1].split(".")[0]
        assert name not in ASKS, f"{function} waits for its device"
        if name in INDEXES:
            indices = [index for index in args[1] if index is not None]
            assert all(index.dtype == torch.long for index in indices), f"{function} by a mask waits for its device"
        tensors = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, Tensor)]
        # a number is taken along with the call
        devices = {tensor.device.type for tensor in tensors if tensor.dim() or name in (*INDEXES, "copy_", "_to_copy")}
        to = kwargs.get("device")
        if name == "_to_copy" and to is not None:
            devices.add(to.type)
        assert len(devices) <= 1, f"{function} copies between devices: {sorted(devices)}"
        return function(*args, **kwargs)
