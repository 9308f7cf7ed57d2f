"""Suggests what a misspelt word was meant to be."""

from __future__ import annotations

from collections.abc import Iterable


def did_you_mean(word: str, choices: Iterable[str]) -> str:
    """``"; did you mean X?"`` of the most similar choice, or ``""`` if none is similar.

    >>> from nablahog.cli.arguments.did_you_mean import did_you_mean
    >>> did_you_mean("invrt", ["hog", "invert"])
    "; did you mean 'invert'?"
    >>> did_you_mean("sift", ["hog", "invert"])
    ''
    """
    import difflib  # slower than all else that --help loads

    names = {choice.casefold(): choice for choice in choices}
    (*near,) = difflib.get_close_matches(word.casefold(), names, n=1, cutoff=0.65)
    return f"; did you mean {names[near[0]]!r}?" if near else ""
