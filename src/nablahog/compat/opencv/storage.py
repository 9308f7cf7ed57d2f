"""Files of ``cv2.HOGDescriptor``: OpenCV's FileStorage as YAML, XML or JSON, also gzipped.

Only what ``HOGDescriptor::write`` of ``hog.cpp`` puts into a file is read; nothing in it is ever run.
"""

from __future__ import annotations

import gzip
import io
import json
import os
import re
import textwrap
import zlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree

import numpy as np

from ...inputs.numbers import shortened
from ...io.files import replacing
from ...io.input_file import InputFile, Readable, input_file
from ...runtime.text import one_line

MAX_STORAGE_BYTES = 2**23  # unpacked: half a million coefficients, where a detector of people has four thousand
MAX_TAGS = 100_000  # of an XML file, whose elements take a hundred times their size
_TYPE = "opencv-object-detector-hog"
_YAML_ENTRY = re.compile(r"(?m)^[ \t]+([\w-]+)[ \t]*:[ \t]*(\[[^\]:]*\]|[^\s\[\]]+)[ \t]*(?:#.*)?$")
_YAML_NOTHING = re.compile(r"(?m)#.*$|^[ \t]*!!\S+|^\.\.\.$|^---.*$")  # comments, the type, ends of documents

Node: TypeAlias = Mapping[str, Any]
"""Numbers and sequences of numbers by their names; as texts, unless JSON has read them."""


def write(path: str | os.PathLike[str], name: str, node: Mapping[str, object]) -> None:
    """Writes integers, floats, tuples of integers and an array of float32 under a name, in the format of the ending."""
    stem = Path(path).name.removesuffix(".gz")
    if not name and (not stem or stem.rfind(".") == 0):
        raise ValueError(f"filename must be the name of a file, and more than its ending, got {one_line(path)!r}")
    form, name = _FORMATS.get(Path(stem).suffix.lower(), _yaml), name or default_name(stem)
    if not re.fullmatch("(?!_$)[A-Za-z_][A-Za-z0-9_-]*" if form is _xml else "[A-Za-z_][A-Za-z0-9_ -]*", name):
        raise ValueError(
            "objname must be ASCII letters, digits, - and _, the first a letter or _, and in XML not _ alone, "
            f"got {shortened(name)}"
        )
    text = form(name, node)
    packed = text.encode() if stem == Path(path).name else gzip.compress(text.encode(), mtime=0)
    with replacing(path) as file:
        file.write(packed)


def default_name(stem: str) -> str:
    """OpenCV's name of the object in a file: the file's own, without its ending, as an identifier."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", stem.rpartition(".")[0] or stem)
    name = name if re.match("[A-Za-z_]", stem) else f"_{name}"
    return "unnamed" if name == "_" else name


_SVM = "opencv_ml_svm"
_OF_SVM = (
    "; if it is a linear SVM, write its weights in one array: "
    "numpy.save('weights.npy', -svm.getSupportVectors()[0]), without the minus for a regression"
)


def read(path: Readable, name: str) -> Node:
    """The node of that name, or the first one; ValueError if there is none, or it is no HOGDescriptor."""
    file = input_file(path)
    file.check("a FileStorage of a HOGDescriptor")
    try:
        nodes = _read_nodes(_read_text(file))
    except (ValueError, ElementTree.ParseError, RecursionError) as error:
        raise ValueError(f"{file}: expected a FileStorage of OpenCV: {one_line(error)}") from None
    node = nodes.get(name) if name else next(iter(nodes.values()), None)
    if not isinstance(node, Mapping) or "winSize" not in node:
        if _SVM in nodes or (isinstance(node, Mapping) and "support_vectors" in node):
            raise ValueError(f"{file}: expected a HOGDescriptor, got an SVM of cv2.ml{_OF_SVM}")
        raise ValueError(f"{file}: expected a HOGDescriptor{f' named {one_line(name)!r}' if name else ''}, got none")
    return node


def integers(node: Node, name: str) -> tuple[int, ...]:
    """One integer, or a sequence of them; ValueError for anything else."""
    values = _read_values(node, name)
    if not np.array_equal(values, np.rint(values)) or np.abs(values).max(initial=0) > 1e9:
        raise ValueError(f"{name} must be integers, got {one_line(node[name])}")
    return tuple(int(value) for value in values)


def floats(node: Node, name: str) -> tuple[float, ...]:
    """One number, or a sequence of them; ValueError for anything else."""
    return tuple(_read_values(node, name).tolist())


def _read_values(node: Node, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    value = node.get(name, "")
    with suppress(OverflowError, ValueError):
        words = _split_numbers(value) if isinstance(value, str) else value if isinstance(value, list) else [value]
        if words and all(isinstance(word, float | int) or isinstance(value, str) for word in words):
            return np.array([float(word) for word in words], np.float64)
    raise ValueError(f"{name} must be numbers, got {one_line(value) or 'nothing'}")


def _split_numbers(text: str) -> list[str]:
    """The numbers of a text, as Python writes them."""
    if not text.isascii() or "_" in text:
        raise ValueError  # which Python allows in numbers
    return text.lower().replace(".nan", "nan").replace(".inf", "inf").strip("[] \n").replace(",", " ").split()


# --- reading ---------------------------------------------------------------------------------------------------------


def _read_text(file: InputFile) -> str:
    data = file.read(MAX_STORAGE_BYTES + 1)
    if data[:2] == b"\x1f\x8b":
        try:
            data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(MAX_STORAGE_BYTES + 1)
        except (EOFError, OSError, zlib.error) as error:
            raise ValueError(f"it cannot be unpacked: {error}") from None
    if len(data) > MAX_STORAGE_BYTES:
        raise ValueError(f"it is larger than {MAX_STORAGE_BYTES:,} bytes{_OF_SVM * (_SVM.encode() in data[:1000])}")
    return data.decode().lstrip("\ufeff \t\r\n")  # UnicodeDecodeError is a ValueError


def _read_nodes(text: str) -> dict[str, Any]:
    if text.startswith("{"):
        nodes = json.loads(text)
        return nodes if isinstance(nodes, dict) else {}
    if text.startswith("<"):
        if "<!DOCTYPE" in text:  # whose entities may grow without limit
            raise ValueError("XML with a DOCTYPE is not read")
        if text.count("<") > MAX_TAGS:
            raise ValueError(f"it has more than {MAX_TAGS:,} tags")
        root = ElementTree.fromstring(text)
        return {node.tag: {entry.tag: entry.text or "" for entry in node} for node in root}
    if not text.startswith(("%YAML", "---")):
        raise ValueError(f"it begins with {one_line(text[:20])!r}")
    return dict(_read_yaml(text))


def _read_yaml(text: str) -> Iterator[tuple[str, dict[str, str]]]:
    """The maps of a document: lines that are not indented begin them."""
    for part in re.split(r"\n(?=[^\s#.\-%])", text.replace("\r", ""))[1:]:
        name, _, content = part.partition(":")
        entries = dict(_YAML_ENTRY.findall(content))
        if "winSize" in entries and (rest := _YAML_NOTHING.sub("", _YAML_ENTRY.sub("", content)).strip()):
            raise ValueError(f"{one_line(rest, 40)!r} is no entry")  # what a file that is cut ends with
        yield name.strip(" \"'"), entries


# --- writing ---------------------------------------------------------------------------------------------------------


def _format_number(value: object, dot: str) -> str:
    if isinstance(value, int):
        return str(value)
    text = f"{value:.9g}" if isinstance(value, np.float32) else f"{value:.17g}"
    if text.lstrip("-").isdigit():
        return text + dot
    return {"nan": ".Nan", "inf": ".Inf", "-inf": "-.Inf"}.get(text, text)


def _format_sequence(value: object, dot: str, between: str, indent: str) -> str:
    words = [_format_number(number, dot) for number in value]  # type: ignore[attr-defined]
    return textwrap.fill(between.join(words), 76, subsequent_indent=indent)


def _format_entries(
    node: Mapping[str, object], entry: str, several: str, dot: str, between: str, indent: int
) -> list[str]:
    """A line for each entry; where it is several numbers, these begin lines with an indent."""
    return [
        entry.format(
            key,
            several.format(_format_sequence(value, dot, between, indent * " "))
            if isinstance(value, tuple | np.ndarray)
            else _format_number(value, dot),
        )
        for key, value in node.items()
    ]


def _yaml(name: str, node: Mapping[str, object]) -> str:
    entries = _format_entries(node, "   {}: {}", "[ {} ]", ".", ", ", 7)
    return "\n".join([f"%YAML:1.0\n---\n{name}: !!{_TYPE}", *entries]) + "\n"


def _xml(name: str, node: Mapping[str, object]) -> str:
    head = f'<?xml version="1.0"?>\n<opencv_storage>\n<{name} type_id="{_TYPE}">'
    entries = _format_entries(node, "  <{0}>{1}</{0}>", "\n    {}", ".", " ", 4)
    return "\n".join([head, *entries]) + f"</{name}>\n</opencv_storage>\n"


def _json(name: str, node: Mapping[str, object]) -> str:
    head = f'{{\n    "{name}": {{\n        "type_id": "{_TYPE}"'
    return ",\n".join([head, *_format_entries(node, '        "{}": {}', "[ {} ]", ".0", ", ", 12)]) + "\n    }\n}\n"


_FORMATS = {".xml": _xml, ".json": _json}
