"""``python -m nablahog``: the same as the command ``nablahog``."""

import sys

from .cli.main import main

sys.exit(main())
