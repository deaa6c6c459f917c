"""The documents on the wire, as pydantic models; those of elements, signals and methods come from the catalogues."""
