"""The reference: exact responses in time and frequency of linear, sampled and nonlinear systems."""
