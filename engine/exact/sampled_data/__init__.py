"""Loops with samplers, exactly: the map over the common period of all rates, its eigenvalues, margins and responses."""
