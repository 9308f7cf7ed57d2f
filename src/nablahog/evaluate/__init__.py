"""The tables of the paper, from a folder of images to a page: which methods, run by whom, counted how."""
