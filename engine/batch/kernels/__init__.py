"""Compiled batch kernels: metrics of thousands of parameter sets of one diagram, eight to a vector of the processor."""
