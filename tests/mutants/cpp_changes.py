"""Changes of C++, by patterns in the form that clang-format gives it: an operator of two operands has spaces around."""

from __future__ import annotations

import re
from collections.abc import Iterator

# comments, literals, lines of the preprocessor and declarations of templates and types stay
SKIPPED = re.compile(
    r"//.*|\"[^\"\n]*\"|'\\?.'|^ *#.*|\btemplate <[^;{)\n]*?>(?= |$)|^ *(?:using|static_assert|namespace)\b.*",
    re.MULTILINE,
)
OPERATORS = {
    **{"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "&&": "||", "||": "&&"},
    **{"+": "-", "-": "+", "*": "/", "/": "*", "%": "/", "&": "|", "|": "&", "+=": "-=", "-=": "+=", "*=": "/="},
}
OPERATOR = re.compile(rf"(?<= )(?:{'|'.join(map(re.escape, sorted(OPERATORS, key=len, reverse=True)))})(?= )")
SIGN = re.compile(r"(?:(?<=[({\[])|(?<=[,=?:] )|(?<=return ))-(?=[a-z_(])")
NUMBER = re.compile(r"(?<![\w.<])(\d+(?:\.\d+)?(?:e-?\d+)?)(?=f?(?![\w.>]))")
TRUTH = re.compile(r"\b(?:true|false)\b")
SIMPLE = r"[\w.\[\]]+"
ARGUMENTS = re.compile(rf"\b(?!min\b|max\b|minimum\b|maximum\b|multiply_add\b)\w+\((({SIMPLE}), ({SIMPLE}))(?=[,)])")
STATEMENT = re.compile(rf"^ +(?!return\b|using\b)({SIMPLE}(?:->{SIMPLE})* [-+*/|&^]?= [^;]*|[\w.:>-]+\([^;]*\));$",
                       re.MULTILINE)  # fmt: skip


def find_changes(source: bytes) -> Iterator[tuple[int, int, int, str]]:
    """Yields line, first byte, end and new text of all changes of a file."""
    whole = source.decode()
    text = SKIPPED.sub(lambda found: " " * len(found[0]), whole)
    for start, end, new in sorted(find_in_text(text)):
        first = len(whole[:start].encode())
        yield text.count("\n", 0, start) + 1, first, first + len(whole[start:end].encode()), new


def find_in_text(text: str) -> Iterator[tuple[int, int, str]]:
    """Yields first character, end and new text of all changes."""
    for found in OPERATOR.finditer(text):
        yield *found.span(), OPERATORS[found[0]]
    for found in SIGN.finditer(text):
        yield *found.span(), ""
    for found in NUMBER.finditer(text):
        yield *found.span(), larger(found[0])
    for found in TRUTH.finditer(text):
        yield *found.span(), "false" if found[0] == "true" else "true"
    for found in ARGUMENTS.finditer(text):
        if found[2] != found[3]:
            yield *found.span(1), f"{found[3]}, {found[2]}"
    for found in STATEMENT.finditer(text):
        yield *found.span(1), ""


def larger(number: str) -> str:
    """Returns an integer's successor, or 5/4 of another number."""
    return str(int(number) + 1) if number.isdecimal() else str(1.25 * float(number) or 1.0)
