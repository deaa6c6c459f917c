"""Comments on what is stored and computed."""
