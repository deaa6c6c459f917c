"""What is remembered: systems, datasets, results and jobs in one SQL database.

``open_database(url)`` gives a `Database`; the repositories in `storage.repositories` take one of its sessions and
never commit, so that a request or a job owns its transaction. This package knows no engine and no HTTP.
"""

from __future__ import annotations

from storage.session import Database, open_database

__all__ = ["Database", "open_database"]
