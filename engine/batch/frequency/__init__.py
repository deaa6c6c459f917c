"""Many candidates of a linear diagram with delays, by collocation."""
