"""Optimisers against published optima and against peers."""
