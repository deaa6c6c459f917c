"""Poles, zeros, gains at rest, frequency responses and margins of linear systems."""
