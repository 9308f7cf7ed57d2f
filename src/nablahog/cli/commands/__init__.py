"""One module per command: a function of its arguments, which returns the exit status, None for 0.

It raises UserError or OSError, which end the command with a line on stderr, where an input is unusable, an option is
wrong, or a result cannot be written.
"""
