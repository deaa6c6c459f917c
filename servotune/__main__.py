"""`python -m servotune` is the `servotune` command."""

from __future__ import annotations

import sys

from servotune.main import main

if __name__ == "__main__":
    sys.exit(main())
