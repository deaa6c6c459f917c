"""Systems to and from other tools: one file per format."""
