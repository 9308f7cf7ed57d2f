"""Data sets: PASCAL VOC and PASCAL3D+ as published, folders of CAD models, procedural chairs, synthetic scenes."""
