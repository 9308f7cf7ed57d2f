"""What the command and the page can be asked: one dataclass each, with defaults, choices, ranges and help.

The options of the command, the JSON and the controls of the page, and the lines that the page shows are made from them.
Importing this package loads neither PyTorch nor NumPy.
"""
