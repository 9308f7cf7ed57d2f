"""Numbers, boxes, cameras and images as people pass them; all kinds of them by all functions: ../boundary."""
