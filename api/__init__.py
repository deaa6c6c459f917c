"""The service: FastAPI at the edge, use cases behind it, the core and the storage below."""
