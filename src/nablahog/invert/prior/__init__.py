"""What to prefer among all images with the same descriptor: terms of Eq. 9, and networks learned from photographs."""
