"""A document as a checked diagram: flattened, connected, realised at any values."""
