"""Modes of measured structures: natural frequencies and damping ratios from frequency response functions, with their errors."""
