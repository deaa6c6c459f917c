"""The demonstration, end to end, on a service of its own."""
