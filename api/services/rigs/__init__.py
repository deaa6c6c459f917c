"""Rigs, their agents and measurements."""
