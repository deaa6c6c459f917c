"""A rig without hardware: the NI interface of a lab PC, with a plant from a system document behind it.

It stands in for hardware, for training, for trying a chain before the rig is free, and for tests. What it shows is a
simulation written from public interfaces; it proves nothing about a module, a cable or a driver.
"""
