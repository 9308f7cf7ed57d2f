"""What the arguments of a command name, read and checked.

An input that is unusable raises ValueError or OSError, of a sentence for the user; where none is left, or an option is
wrong, UserError.
"""
