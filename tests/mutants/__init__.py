"""Breaks the package one line at a time, and lists the lines whose breaking no test notices: ``make mutants``."""
