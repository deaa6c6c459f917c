"""Databases for every integration test."""

from __future__ import annotations

from tests.support.databases import (
    database,
    database_url,
    empty_database_url,
    fresh_database,
    module_database_url,
    postgres_template,
    postgres_url,
    shared_database,
    sqlite_template,
)

__all__ = [
    "database",
    "database_url",
    "empty_database_url",
    "fresh_database",
    "module_database_url",
    "postgres_template",
    "postgres_url",
    "shared_database",
    "sqlite_template",
]
