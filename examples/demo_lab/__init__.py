"""A day in the lab in a minute: a rig is measured, understood, improved, and measured again; without any hardware.

The rig is simulated and stands in for hardware. It differs from the textbook in ways that the model has to find out, and in one
that no element of the library can describe.
"""
