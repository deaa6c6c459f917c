"""Controllers with an OPC UA server: they record into a ring of arrays, and play a drive that they were given before."""
