"""Exact responses of linear systems in time, by pieces of polynomials."""
