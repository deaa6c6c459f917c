"""Parameters of a system from recordings: grey-box output-error estimation, and how far it can be trusted.

    minimize over p   Σ_e Σ_o Σ_t (y_eo(t) - ŷ_eo(t; p) - c_eo)² / (n_e var y_eo)

ŷ is the response of the whole model to the recorded inputs from the recording's start (a simulation, never a
one-step prediction), c the constant offset of a sensor. Any addressable parameter may be unknown; several experiments
count at once; free motions from unknown initial states are estimated where asked for.

References
----------
L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, sections 7.2 and 10.2.
"""

from __future__ import annotations

from optimizers.identification.expected import Expected, expected
from optimizers.identification.identify import identify
from optimizers.identification.result import Estimate, Identified, Judged

__all__ = ["Estimate", "Expected", "Identified", "Judged", "expected", "identify"]
