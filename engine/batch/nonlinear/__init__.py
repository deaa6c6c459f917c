"""Many candidates of a nonlinear diagram at once: its equations as a tape, marched in steps of one length for all."""
