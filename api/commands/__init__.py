"""`servotune serve`, `worker`, `backup` and the others of an installation."""
