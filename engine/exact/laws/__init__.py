"""Nonlinear laws and the linear system around them."""
