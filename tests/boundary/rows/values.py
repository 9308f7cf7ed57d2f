"""Sizes, boxes, angles, numbers and names, as NumPy, PyTorch, files and detectors give them."""

from __future__ import annotations

import enum
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import torch

from nablahog import presets

from ..table import Kind, Row, rows

TENSOR = torch.tensor
LARGE = 10**30
LIMITS = dict.fromkeys(("stream", "train_prior", "Search"), "the number is a limit, and this one is none")
VECTORS = dict.fromkeys(("metrics", "metrics of views"), "takes angles of any shape")
THRESHOLD = {"compat.opencv": "a threshold may be any number, as in OpenCV"}
LEFT_OUT = {
    "very large": LIMITS,
    "two numbers": VECTORS,
    "array of two": VECTORS,
    "NaN": THRESHOLD,
    "infinity": THRESHOLD,
}


def scalars(kind: Kind, of: type) -> list[Row]:
    """Other forms of one number, which any function that takes one has to take."""
    forms: dict[str, Callable[[Any], Any]] = {
        "np.int64": np.int64,
        "np.int32": np.int32,
        "np.uint16": np.uint16,
        "array ()": np.array,
        "tensor int64": lambda n: TENSOR(int(n)),
        "of an enumeration": lambda n: enum.IntEnum("Number", {"N": int(n)}).N,
        "of a subclass": lambda n: type("Number", (of,), {})(n),
    }
    if of is float:
        forms |= {
            "int": int,
            "np.float32": np.float32,
            "np.float64": np.float64,
            "np.float16": np.float16,
            "tensor float32": lambda n: TENSOR(float(n)),
            "tensor float64": lambda n: TENSOR(float(n), dtype=torch.float64),
            "tensor requires_grad": lambda n: TENSOR(float(n), requires_grad=True),
        }
    taken = [Row(f"{kind} {name}", kind, make, must="be taken", tolerance=1e-5) for name, make in forms.items()]
    either = {
        "array of one": lambda n: np.array([n]),
        "list of one": lambda n: [n],
        "tensor of one": lambda n: TENSOR([n]),
        "Fraction": Fraction,
        "Decimal": Decimal,
        "a text": str,
        "whole float": float,
    }
    refused = {
        "NaN": lambda n: float("nan"),
        "infinity": lambda n: float("inf"),
        "a word": lambda n: "abc",
        "complex": lambda n: complex(n),
        "two numbers": lambda n: (n, n),
        "a dict": lambda n: {"n": n},
        "array of two": lambda n: np.array([n, n]),
    }
    if of is int:
        refused |= {
            "a half": lambda n: n + 0.5,
            "np.float64 half": lambda n: np.float64(n + 0.5),
            "very large": lambda n: LARGE,
            "very small": lambda n: -LARGE,
        }
    return [
        *taken,
        *[Row(f"{kind} {name}", kind, make, tolerance=1e-5) for name, make in either.items()],
        *[
            Row(f"{kind} {name}", kind, make, must="be refused", leaves_out=LEFT_OUT.get(name, {}))
            for name, make in refused.items()
        ],
    ]


SIZES_TAKEN = {
    "list": list,
    "np.int64": lambda s: tuple(map(np.int64, s)),
    "array int64": np.array,
    "array int32": lambda s: np.array(s, np.int32),
    "array uint8": lambda s: np.array(s, np.uint8),
    "tensor": TENSOR,
    "torch.Size": torch.Size,
    "tensors": lambda s: tuple(map(TENSOR, s)),
    "of an enumeration": lambda s: tuple(enum.IntEnum("Side", {"H": s[0], "W": s[1]}).__members__.values()),
}
SIZES_REFUSED = {
    "of three numbers": lambda s: (*s, 3),
    "array of three numbers": lambda s: np.array([*s, 3]),
    "of one number in a tuple": lambda s: s[:1],
    "halves": lambda s: tuple(n + 0.5 for n in s),
    "array of halves": lambda s: np.array(s) + 0.5,
    "negative": lambda s: (-s[0], s[1]),
    "zero": lambda s: (0, s[1]),
    "booleans": lambda s: (True, True),
    "NaN": lambda s: (float("nan"), s[1]),
    "array (2, 2)": lambda s: np.array([s, s]),
    "of None": lambda s: (None, s[1]),
    "empty": lambda s: (),
    "a dict": lambda s: {"height": s[0], "width": s[1]},
    "very large": lambda s: (LARGE, LARGE),
}
SIZES = [
    *rows("size", SIZES_TAKEN, must="be taken"),
    Row("size one number", "size", lambda s: s[0], means=lambda s: (s[0], s[0])),
    Row("size np.int64 alone", "size", lambda s: np.int64(s[0]), means=lambda s: (s[0], s[0])),
    Row("size whole floats", "size", lambda s: tuple(map(float, s))),
    Row("size array of whole floats", "size", lambda s: np.array(s, float)),
    Row("size text", "size", lambda s: f"{s[0]}x{s[1]}"),
    Row("size iterator", "size", iter),
    *rows("size", SIZES_REFUSED, must="be refused"),
]
BOXES_TAKEN = {
    "list": list,
    "floats": lambda b: tuple(map(float, b)),
    "array int64": np.array,
    "array int32": lambda b: np.array(b, np.int32),
    "array float32": lambda b: np.array(b, np.float32),
    "array float64": lambda b: np.array(b, float),
    "np.float32": lambda b: tuple(map(np.float32, b)),
    "tensor float32": lambda b: TENSOR(b, dtype=torch.float32),
    "tensor int64": TENSOR,
    "tensors": lambda b: [TENSOR(float(side)) for side in b],
    "tensor requires_grad": lambda b: TENSOR(b, dtype=torch.float32, requires_grad=True),
    "array read-only": lambda b: np.broadcast_to(np.array(b, np.float32), (2, 4))[0],
}
BOXES_REFUSED = {
    "three numbers": lambda b: b[:3],
    "one number": lambda b: b[0],
    "NaN": lambda b: (float("nan"), *b[1:]),
    "array with NaN": lambda b: np.array([np.nan, *b[1:]]),
    "x, y, width, height": lambda b: (30, 30, 12, 14),
    "upside down": lambda b: (b[2], b[3], b[0], b[1]),
    "outside": lambda b: (500, 500, 600, 600),
    "empty": lambda b: (),
    "of two boxes": lambda b: np.array([b, b]),
    "infinite": lambda b: (*b[:3], float("inf")),
    "None inside": lambda b: (None, *b[1:]),
    "a dict": lambda b: dict(zip("xywh", b, strict=True)),
    "complex": lambda b: np.array(b, complex),
    "words": lambda b: tuple("abcd"),
    "very large": lambda b: (LARGE,) * 4,
    "masked": lambda b: np.ma.masked_array(b, [1, 0, 0, 0]),
}
BOXES = [
    *rows("box", BOXES_TAKEN, must="be taken", tolerance=1e-4),
    Row("box array (1, 4)", "box", lambda b: np.array([b], np.float32)),
    Row("box in a list", "box", lambda b: [b]),
    Row("box array float16", "box", lambda b: np.array(b, np.float16), tolerance=1e-4),
    Row("box iterator", "box", iter),
    Row("box texts", "box", lambda b: tuple(map(str, b))),
    Row("box one text", "box", lambda b: ",".join(map(str, b))),
    Row("box with a score", "box", lambda b: (*b, 0.9)),
    Row("box detector's row", "box", lambda b: np.array([*b, 0.9, 7], np.float32)),
    *rows("box", BOXES_REFUSED, must="be refused"),
]


class Name(str, enum.Enum):
    """Names as an enumeration of texts."""

    UOCTTI = "uoctti"


NAMES = [
    Row("name np.str_", "name", np.str_, must="be taken"),
    Row("name in an enumeration", "name", lambda n: Name(n), must="be taken"),
    Row("name as a spec", "name", lambda n: getattr(presets, n)(), must="be taken"),
    *[
        Row(f"name {name}", "name", make, must=must, leaves_out={"page": "the default"} if name == "None" else {})
        for name, make, must in [
            ("array ()", np.array, "either"),
            ("in capitals", str.upper, "either"),
            ("with spaces", lambda n: f" {n} ", "either"),
            ("as the preset's function", lambda n: getattr(presets, n), "either"),
            ("with brackets", lambda n: f"{n}()", "either"),
            ("bytes", str.encode, "either"),
            ("None", lambda n: None, "be refused"),
            ("empty", lambda n: "", "be refused"),
            ("unknown", lambda n: "sift", "be refused"),
            ("in a list", lambda n: [n], "be refused"),
            ("a number", lambda n: 8, "be refused"),
            ("a dict", lambda n: {n: 1}, "be refused"),
            ("as settings", lambda n: '{"cell_size": 8}', "be refused"),
        ]
    ],
]
ROWS = [*SIZES, *BOXES, *scalars("angle", float), *scalars("number", int), *NAMES]
