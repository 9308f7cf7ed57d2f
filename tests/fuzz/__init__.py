"""Hostile input, made by programs: some cases in every run of the tests, many with ``make fuzz``."""
