"""Databases for every integration test."""

from __future__ import annotations

from tests.support.databases import (
    database,
    database_url,
    empty_database_url,
    module_database_url,
    postgres_template,
    postgres_url,
    sqlite_template,
)

__all__ = [
    "database",
    "database_url",
    "empty_database_url",
    "module_database_url",
    "postgres_template",
    "postgres_url",
    "sqlite_template",
]
