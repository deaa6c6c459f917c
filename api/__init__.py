"""The service: FastAPI at the edge, use cases behind it, the core and the storage below.

Its matrices are small, and requests and jobs are computed beside each other: several threads of linear algebra for each of them
would wait for one another.
"""

from __future__ import annotations

import os

# Read when numpy is loaded, and inherited: this package comes first in the server, in a worker and in what computes its jobs.
# OpenBLAS and MKL follow it unless their own variables are set.
os.environ.setdefault("OMP_NUM_THREADS", "1")
