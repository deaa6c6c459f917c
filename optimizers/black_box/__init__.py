"""Models without a diagram: where there is no physical structure yet, or to see what a recording holds at all.

Two ways: state spaces by subspaces, for any number of signals, and transfer functions with a delay, for one path. Both give
discrete models, whose order is chosen by what they simulate on samples that did not take part, and which become
continuous ones for inputs in straight lines between the samples: the same holds in every simulation here.

Own code, on numpy: the packages there are (SIPPY, nfoursid) have had no release for years or bring a control library along,
and the method is a decomposition and two regressions.
"""

from __future__ import annotations

from optimizers.black_box.checks import checked
from optimizers.black_box.choice import BlackBox, Tried, black_box
from optimizers.black_box.continuous import Continuous

__all__ = ["BlackBox", "Continuous", "Tried", "black_box", "checked"]
