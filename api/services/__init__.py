"""The use cases. They know the core, the storage and the wire documents, but no web framework."""
