"""Processing of recordings: one file = one step, each a pure function from a record to a new one."""
