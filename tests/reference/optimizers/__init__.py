"""Optima against published ones, closed forms and independent searches."""
