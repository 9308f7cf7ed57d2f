"""A function of its arguments for each command, which returns the exit status, or raises ValueError or OSError."""
