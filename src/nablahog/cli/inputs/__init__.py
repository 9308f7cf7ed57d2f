"""What the arguments of a command name, read and checked; ValueError, OSError or UserError has a sentence for the user."""
