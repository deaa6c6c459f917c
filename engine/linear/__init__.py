"""Exact responses of linear systems with internal delays."""
