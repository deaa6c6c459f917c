"""Identifications, by a worker."""
