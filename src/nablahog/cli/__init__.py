"""The command ``nablahog``."""
