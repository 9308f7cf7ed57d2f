"""Threads, memory, caches, lazy imports; knows nothing of HOG."""
