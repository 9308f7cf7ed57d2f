"""Files in and out."""

from typing import TYPE_CHECKING

from ..runtime.lazy import names_when_used

if TYPE_CHECKING:
    from .descriptor_file import StoredDescriptor, load_descriptor, save_descriptor

__all__ = ["StoredDescriptor", "load_descriptor", "save_descriptor"]

names_when_used(__name__, descriptor_file=("StoredDescriptor", "load_descriptor", "save_descriptor"))
