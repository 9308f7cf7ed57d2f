"""What exists only to reproduce the paper: baselines, Tables 1 and 2, PASCAL VOC, PASCAL3D+, scenes of chairs."""
