"""How long tests wait for what must come: far longer than any load makes it take, so that no test depends on a machine's speed."""

PATIENCE = 240
"""Seconds."""
