"""Quantities with units, converted to SI at the edge."""
