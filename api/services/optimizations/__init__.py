"""Optimisations, by workers."""
