"""A second measurement of goals, for the certificate alone: it shares no code with what an optimiser evaluates.

Of the engine it takes the matrices of the system, the values of the commands and nothing else. Responses are propagated by
exponentials of the whole step (`march`), gains are solved for one by one on a grid that refines itself (`sweep`), and what is
read off them (`timing`, `margins`) is written out again. What it cannot follow it says nothing about.
"""

from __future__ import annotations

from optimizers.independent_check.march import CannotFollowError
from optimizers.independent_check.statement import Statement, witnessed

__all__ = ["CannotFollowError", "Statement", "witnessed"]
