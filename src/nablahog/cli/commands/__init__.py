"""A function of its arguments for each command, which returns the exit status, or raises UserError or OSError."""
