"""Damage that knows the format: members of a container are changed, and its lengths and checksums adapted."""

from __future__ import annotations

import copy
import gzip
import io
import json
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np

from .file_seeds import Seed, seeds

LARGEST = 2**20  # bytes of a file, and numbers of an array
Mutation = Callable[[bytes, Random], bytes]
Array = np.ndarray[Any, Any]

NUMBERS = ["0", "-1", "1", "3", "nan", "inf", "-inf", "1e999", "1e-320", "1e308", "-0", "0x10", "1_000", "4294967295"]
SIGNS = ["", "٣", "é", "true", "null", *'/-#\\"<(fv', "//", "&lt;", "\u202e", "\x85", "usemtl", "list", "\x1b[31m"]
WORDS = [*NUMBERS, *SIGNS, "2147483648", "9" * 20, "\0", "=1+1", "9" * 400, "9" * 5000, "x" * 3000]
VALUES: list[Any] = [None, True, False, 0, -1, 1, 2, 3, 7, 1.5, 1e-320, 1e-200, 1e30, 1e308, float("nan"), float("inf")]
VALUES += [2**15, 10**5, 2**31, 2**32, 2**63, 10**9, 10**30, 10**400, "", "x", "\x1b[31m", "x\ny", "x" * 10**5, [], {}]
VALUES += [[1], [1, 2], [1e5, 1e5], [10**5, 10**5], [10**4] * 2, [None], {"kind": "x"}, [[]], "cells", "gray", "none"]
BYTES = [b"\0", b"\xff", b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\xff" * 8, b"\0" * 8, b"\0\0\x80\x7f"]
BYTES += [struct.pack("<d", value) for value in (float("nan"), float("inf"), 1e308, -1.0, 1e18, 0.5)]
BYTES += [struct.pack(order + "I", number) for order in "<>" for number in (40_000, 2**30)]
SHAPES: list[Any] = [(10**9, 31), (0,), (-1, 4), (10**30,), (1,) * 100, (2**31, 2**31, 4), (10**10, 0), (31,), ()]
TYPES = ["<f8", "<f4", "|O", "<U4", "<U1000000000", ">f8", "|V0", "<c16", "<M8[s]", "|S0", "f2"]
CHUNKS = (b"tEXt", b"zTXt", b"iTXt", b"iCCP", b"eXIf", b"tRNS", b"PLTE", b"acTL", b"fcTL", b"gAMA", b"pHYs")


def mutated(seed: Seed, random: Random) -> bytes:
    """A damaged copy of a file."""
    data = seed.data
    for _ in range(random.choice((1, 1, 1, 2, 3, 5))):
        mutation = _STRUCTURED[seed.kind] if random.random() < 0.8 else change_bytes
        try:
            data = mutation(data, random)
        except Exception:  # what is already damaged has no structure
            data = change_bytes(data, random)
        data = data[:LARGEST]
    return data


def change_bytes(data: bytes, random: Random) -> bytes:
    """Flips, cuts, copies and overwrites."""
    at, until = sorted(random.randrange(len(data) + 1) for _ in range(2))
    before, after, word = data[:at], data[at:], random.choice(BYTES)
    other = random.choice(seeds()).data
    flipped = bytes(byte ^ 1 << random.randrange(8) for byte in after[:1])
    return random.choice(
        [
            *[before + flipped + after[1:], before + word + after[len(word) :]] * 2,
            before,
            before + data[until:],
            data[:until] + after,
            before + after[:40] * random.choice((2, 10, 300)) + after[40:],
            before + word + after,
            before + random.randbytes(random.randrange(30)) + data[until:],
            before + other[len(other) // 2 :],
            data + other,
        ]
    )


def change_text(data: bytes, random: Random) -> bytes:
    """Changes words and lines."""
    lines = data.decode("utf-8", "surrogateescape").split("\n")
    at, other = random.randrange(len(lines)), random.randrange(len(lines))
    words = lines[at].split(" ")
    word, how = random.randrange(len(words)), random.randrange(14)
    most = LARGEST // (len(lines[at]) + 1)  # repetitions, or the file would become too large
    if how < 5:
        words[word] = random.choice(WORDS)
    elif how == 5:
        words[word] += random.choice(WORDS)
    elif how == 6:
        words[word : word + 1] = [words[word]] * min(most, random.choice((0, 2, 5, 1000)))
    elif how == 7:
        words[word] = words[word] * min(most, random.choice((2, 100, 10_000)))
    lines[at] = " ".join(words)
    if how == 8:
        lines[at : at + 1] = [lines[at]] * min(most, random.choice((0, 2, 10, 3000)))
    elif how == 9:
        lines[at:at] = [random.choice(("", " ", "\t", "#", "# x", "\r", "\x0c"))] * random.choice((1, 100, 20_000))
    elif how == 10:
        lines[at : at + 1] = [random.choice(("[", "{", "(", "<a>", '"', "\\", "-")) * random.choice((3, 3000, 60_000))]
    elif how == 11:
        lines[at], lines[other] = lines[other], lines[at]
    text = (random.choice(("\r\n", "\r", " ")) if how == 12 else "\n").join(lines)
    if how == 13:  # in the middle of a word, as in tags
        number = random.randrange(len(text) + 1)
        text = text[:number] + random.choice(WORDS) + text[number + random.randrange(3) :]
    return text.encode("utf-8", "surrogateescape")


def change_json(data: bytes, random: Random) -> bytes:
    """Changes a value anywhere in the tree."""
    text = json.dumps(change_tree(json.loads(data), random))
    if random.random() < 0.05:
        opening = random.choice(("[", '{"a":'))
        text = text.replace(random.choice(("1", "null", "0")), opening * random.choice((10, 100_000)), 1)
    return text.encode()


def change_tree(tree: Any, random: Random) -> Any:
    """A copy of lists and mappings with one entry changed, gone, repeated or renamed."""
    tree = copy.deepcopy(tree)
    places = [(None, None, tree)]
    for _, _, value in places:  # grows
        entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        places += [(value, key, entry) for key, entry in entries]
    if len(places) == 1:
        return random.choice(VALUES)
    parent, key, value = random.choice(places[1:])
    how = random.randrange(8)
    if how == 0:
        del parent[key]
    elif how == 1 and isinstance(parent, list):
        parent[key:key] = [value] * random.choice((1, 10, 3000))
    elif how == 1:
        parent[random.choice(WORDS)] = parent.pop(key)
    elif how == 2 and isinstance(value, int | float):
        parent[key] = value * random.choice((-1, 0.5, 2, 1000, 10**6, 10**12)) + random.choice((-1, 0, 1))
    elif how == 3:
        parent[key] = random.choice((value, [value], {"a": value}, str(value)))
    elif how == 4:
        parent[key] = copy.deepcopy(random.choice(places)[2])
    else:
        parent[key] = random.choice(VALUES)
    return tree


def change_npy(data: bytes, random: Random) -> bytes:
    """Changes the header, or the array."""
    if random.random() < 0.5:
        return _npy(change_array(_load(data), random))
    length = int.from_bytes(data[8:10], "little")
    header, body = data[10 : 10 + length], data[10 + length :]
    if random.random() < 0.6:
        entries = {"descr": random.choice(TYPES), "fortran_order": random.random() < 0.5}
        header = str(entries | {"shape": random.choice(SHAPES)}).encode() + b"\n"
    else:
        header = change_text(header, random)[:60_000]
    return data[:8] + struct.pack("<H", len(header)) + header + body


def change_array(array: Array, random: Random) -> Array:
    """Other values, shapes and types."""
    if array.dtype.kind == "U" and array.shape == () and random.random() < 0.8:
        text = str(array.item())
        change = change_json if text[:1] in "[{" else change_text
        return np.array(change(text.encode(), random).decode("utf-8", "replace"))
    how = random.randrange(10)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if how < 3 and array.size:
            changed, value = (
                array.copy(),
                random.choice([np.nan, np.inf, -np.inf, 1e308, -1, 0, 1e-320, 255, 1e30, 1e6]),
            )
            changed.reshape(-1)[random.randrange(array.size)] = np.array(value).astype(array.dtype)
            return changed
        if how == 3:
            return array.astype(random.choice(["f2", "f4", ">f4", "f8", "i1", "u8", "i8", "?", "c8", "S3", "O", "g"]))
        if how == 4:
            flat = array.reshape(-1)
            return random.choice([flat, array[None], array.T, array[:0], array[..., None], flat[:1]])
        if how == 5:
            return np.array(random.choice([0, 1, 1.5, "x", "{}", True, 1j, 2**63, np.nan, "\x1b[31m", b"x", 10**18]))
        if how == 6:
            shapes: list[Any] = [(0,), (1,), (0, 0), (3, 0, 4), (10**6,), (1000, 1000), (1,) * 20]
            return np.zeros(random.choice(shapes), array.dtype)
        if how == 7 and array.ndim:
            return np.concatenate([array] * random.choice((2, 3, 100)), axis=random.randrange(array.ndim))
        if how == 8:
            return array * array.dtype.type(random.choice((-1, 2, 100)))
        return np.zeros(2, [("a", "f4"), ("b", "O" if random.random() < 0.3 else "i8")])


def _load(data: bytes) -> Array:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        array = np.load(io.BytesIO(data))
    if array.size > LARGEST:
        raise ValueError("too large to be changed")
    return array


def _npy(array: Array) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def change_zip(data: bytes, random: Random) -> bytes:
    """Changes a member, or which there are."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    at, how = random.randrange(len(members)), random.randrange(12)
    name, member = members[at]
    if how < 6:
        members[at] = (name, _npy(change_array(_load(member), random)))
    elif how < 8:
        members[at] = (name, change_npy(member, random))
    elif how == 8:
        members[at] = (name, random.choice((b"", b"x", b"PK\x03\x04", b"\x93NUMPY", change_bytes(member, random))))
    elif how == 9:
        bare = name.removesuffix(".npy")
        members[at] = (random.choice((bare, f"../{name}", f"{name}\x1b[31m", "", "a" * 3000, "format.npy")), member)
    elif how == 10:
        del members[at]
    else:
        members.append((random.choice((name, "readme.txt", "more.npy", "\x1b[31m.npy")), member))
    file = io.BytesIO()
    packing = random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2))
    with warnings.catch_warnings(), zipfile.ZipFile(file, "w", packing) as archive:
        warnings.simplefilter("ignore")  # of two members of one name
        for each, content in members:
            archive.writestr(each, content)
    return file.getvalue()


def change_glb(data: bytes, random: Random) -> bytes:
    """Changes the header's tree, or the binary chunk."""
    end = 20 + int.from_bytes(data[12:16], "little")
    header, binary = data[20:end], data[end + 8 :]
    if random.random() < 0.85:
        header = change_json(header, random)
    else:
        binary = change_bytes(binary, random)
    header += b" " * (-len(header) % 4)
    chunks = struct.pack("<I", len(header)) + b"JSON" + header + struct.pack("<I", len(binary)) + b"BIN\0" + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def change_gzip(data: bytes, random: Random) -> bytes:
    """Changes the text before it is packed; sometimes cuts it, or packs it in two."""
    text = change_text(gzip.decompress(data), random)
    at, packed = random.randrange(len(text) + 1), gzip.compress(text, mtime=0)
    in_two = gzip.compress(text[:at], mtime=0) + gzip.compress(text[at:], mtime=0)
    return random.choice([in_two, packed[: random.randrange(len(packed))], *[packed] * 6])


def change_mat(data: bytes, random: Random) -> bytes:
    """Changes the bytes of a variable before it is packed: anything, a number, a tag or a dimension."""
    kind, length = struct.unpack("<II", data[128:136])
    body, rest = data[136 : 136 + length], data[136 + length :]
    if kind == 15:
        body = zlib.decompress(body)[8:]
    number = struct.pack("<d", random.choice((np.nan, np.inf, -np.inf, 1e308, -1, 0.5, 1e6)))
    sizes = (0, 1, 8, 16, 2**31, 2**32 - 1, 56)
    tag = struct.pack("<II", random.choice((*range(1, 20), 2**31)), random.choice(sizes))
    dimension = struct.pack("<i", random.choice((-1, 0, 1, 2, 4, 6, 9, 16, 2**31 - 1, 65536)))
    word = random.choice((None, number, tag, dimension))
    if word is None:
        body = change_bytes(body, random)
    else:
        place = random.randrange(0, len(body), len(word))
        body = body[:place] + word + body[place + len(word) :]
    element = struct.pack("<II", 14, len(body)) + body
    if kind == 15:
        element = zlib.compress(element)
        element = struct.pack("<II", 15, len(element)) + element
    return data[:128] + element + rest


def change_png(data: bytes, random: Random) -> bytes:
    """Changes a chunk, or adds one."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += length + 12
    at, how = random.randrange(len(chunks)), random.randrange(6)
    (name, content), head = chunks[at], chunks[0][1]
    if how == 0:
        sides = random.choice(((0, 7), (60_000, 60_000), (9000, 9000), (2**31 - 1, 1), (7, 3000)))
        chunks[0] = (b"IHDR", struct.pack(">II", *sides) + head[8:])
    elif how == 1:
        kind = bytes((random.choice((1, 2, 4, 8, 16)), random.randrange(8)))
        chunks[0] = (b"IHDR", head[:8] + kind + head[10:])
    elif how == 2:
        chunks[at] = (name, change_bytes(content, random))
    elif how == 3 and name == b"IDAT":
        chunks[at] = (name, zlib.compress(change_bytes(zlib.decompress(content), random)))
    elif how == 4:
        packed = b"a\0\0" + zlib.compress(bytes(random.choice((10, 10**7))))
        content = random.choice((b"", packed, random.randbytes(26), b"\0" * 8))
        chunks.insert(random.randrange(1, len(chunks)), (random.choice(CHUNKS), content))
    else:
        chunks.insert(at, random.choice(chunks))
    pieces = ((struct.pack(">I", len(each)), name + each) for name, each in chunks)
    return data[:8] + b"".join(size + body + struct.pack(">I", zlib.crc32(body)) for size, body in pieces)


_STRUCTURED: dict[str, Mutation] = {
    "bytes": change_bytes,
    "text": change_text,
    "json": change_json,
    "zip": change_zip,
    "npy": change_npy,
    "glb": change_glb,
    "mat": change_mat,
    "png": change_png,
    "gzip": change_gzip,
}
