"""Studies of a system: computed at once, kept, or live."""
