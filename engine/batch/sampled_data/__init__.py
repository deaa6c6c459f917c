"""Many candidates with samplers at once: systems that flow between instants and jump at them."""
