"""Many candidates of one diagram at once: what an optimiser looks at."""
