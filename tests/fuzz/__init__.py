"""Hostile input, made by programs: a short profile in every run of the tests, a long one by ``make fuzz``."""
