"""Validations, at once or by a worker."""
