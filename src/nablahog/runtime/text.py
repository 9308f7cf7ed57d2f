"""Text from files and file names, fit for a terminal and for a sentence."""

from __future__ import annotations

import codecs
import os
from collections.abc import Iterable

MOST_ERROR_CHARACTERS = 900  # of a sentence: with the name of the command, a line has at most 1000
MOST_QUOTED_CHARACTERS = 800  # in a sentence, beside a path
ELLIPSIS = " … "
_FORMULAS = ("=", "+", "-", "@", "＝", "＋", "－", "＠")  # the last are full-width


def decode_text(data: bytes) -> str:
    """Decodes the text of a file in UTF-8, or in UTF-16 with a byte order mark, as editors of Windows write it.

    Raises:
        UnicodeDecodeError: it is neither.
    """
    return data.decode("utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig")


def to_unicode(name: str) -> str:
    """A file's name as text that can be written: names may be in any encoding, and the locale may lack letters."""
    return name.encode(errors="surrogateescape").decode(errors="backslashreplace")


def printable(text: str) -> str:
    r"""``text`` with escapes for what a terminal would obey: control characters, line breaks, bidirectional marks.

    >>> from nablahog.runtime.text import printable
    >>> printable("a\x1b[31m.png")
    'a\\x1b[31m.png'
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape", "surrogatepass").decode() for letter in text
    )


def guard_formula(text: str) -> str:
    """``text`` with an apostrophe before what a spreadsheet would take for a formula."""
    return f"'{text}" if text.startswith(_FORMULAS) else text


def unguard_formula(text: str) -> str:
    """The text that :func:`guard_formula` made this of."""
    return text[1:] if text.startswith("'") and text[1:].startswith(_FORMULAS) else text


def counted(number: int, noun: str) -> str:
    """``"1 image"``, ``"2 images"``."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"


def did_you_mean(word: str, choices: Iterable[str]) -> str:
    """``"; did you mean X?"`` of the most similar choice, or ``""`` if none is similar."""
    import difflib  # slower than all else that --help loads

    names = {choice.casefold(): choice for choice in choices}
    near = difflib.get_close_matches(word.casefold(), names, n=1, cutoff=0.65)
    return f"; did you mean {names[near[0]]!r}?" if near else ""


def most_similar(word: str, choices: Iterable[str], most: int = 5) -> list[str]:
    """The choices that are most like a word, which is none of them, the most similar first."""
    import difflib

    return difflib.get_close_matches(word, choices, n=most, cutoff=0)


def describe_type(value: object, path: str, items: str) -> str:
    """The end of a sentence that refuses ``value``: its type, or what to write for a path, or the items of a list."""
    kind = type(value).__name__
    if isinstance(value, str | os.PathLike):
        return f"a path: write {path}"
    return f"a {kind}: write {items}" if isinstance(value, list | tuple) else kind


def one_line(message: object, most: int = MOST_QUOTED_CHARACTERS) -> str:
    """A message in one printable line of at most ``most`` characters; of a longer one, the middle is left out."""
    text = printable(" ".join(str(message).split()))
    if len(text) <= most:
        return text
    half = (most - len(ELLIPSIS)) // 2
    return f"{text[:half]}{ELLIPSIS}{text[-half:]}"
