"""Diagrams with nonlinear blocks: simulation with located events, operating points, linearisation."""
