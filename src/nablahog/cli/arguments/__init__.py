"""The arguments of the commands, which are all that ``--help`` loads."""
