"""Ways to the hardware of a rig: each is a package of its own behind one interface, found by its entry point."""
