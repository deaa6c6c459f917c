"""From the wire to the core and back: the only place where the two meet."""
