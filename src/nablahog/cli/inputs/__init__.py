"""What the arguments of a command name, read and checked; what is unusable raises an error of one sentence."""
