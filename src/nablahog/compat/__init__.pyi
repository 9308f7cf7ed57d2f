from . import opencv as opencv, skimage as skimage
