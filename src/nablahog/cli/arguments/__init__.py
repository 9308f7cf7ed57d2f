"""What the commands' parsers take: all that ``--help`` loads."""
