"""Regressions and the colour of residuals: estimates that need no simulation."""
