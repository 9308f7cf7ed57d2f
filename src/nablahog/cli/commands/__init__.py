"""A function of its arguments for each command; it returns the exit status, None for 0, or raises UserError or OSError."""
