"""The methods that the paper compares with: BoVW, HOGgles and CNN-HOG in Table 1, exemplars in Table 2."""
