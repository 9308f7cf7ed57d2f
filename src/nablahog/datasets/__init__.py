"""Test objects and where they come from: VOC and PASCAL3D+ as published, CAD folders, and a benchmark of our own."""
