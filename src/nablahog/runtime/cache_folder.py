"""The user's folder for caches."""

from __future__ import annotations

import os
from pathlib import Path

VARIABLE = "NABLAHOG_CACHE_DIR"


def cache_folder() -> Path:
    """The folder that the environment variable ``NABLAHOG_CACHE_DIR`` names, else one of the user's caches.

    It need not exist.

    Raises:
        FileNotFoundError: the user has no home.
    """
    given = os.environ.get(VARIABLE)
    if given:
        return Path(given).absolute()
    from platformdirs import user_cache_path

    path = user_cache_path("nablahog")
    if not path.is_absolute():  # "~" where there is no home
        raise FileNotFoundError(f"there is no folder for caches: the user has no home, and {VARIABLE} is not set")
    return path
