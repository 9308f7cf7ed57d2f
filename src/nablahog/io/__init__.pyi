from .descriptor_file import (
    StoredDescriptor as StoredDescriptor,
    load_descriptor as load_descriptor,
    save_descriptor as save_descriptor,
)
