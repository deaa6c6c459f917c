"""Convex optimisation of what the exact frequency response is linear in: controllers, placement, limits of performance."""
