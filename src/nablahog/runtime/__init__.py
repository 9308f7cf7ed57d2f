"""Compilation, vector instructions, threads, lazy imports; knows nothing of HOG."""
