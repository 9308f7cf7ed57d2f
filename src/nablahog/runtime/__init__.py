"""Threads, memory, caches, names that are loaded when used; knows nothing of HOG."""
