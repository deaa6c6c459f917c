"""The client library and the `servotune` command."""
