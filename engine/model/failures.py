"""Where numbers fail: what numpy, scipy and Python raise then, turned into the engine's own error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import numpy as np

from engine.model.errors import UnresolvedError

_FAILURES: Final = (np.linalg.LinAlgError, ArithmeticError)
_NOT_FINITE: Final = "infs or NaNs"
"""In what scipy says, as a ValueError, of matrices that are not finite."""


@contextmanager
def numerical(what: str = "the system") -> Iterator[None]:
    """Raise an UnresolvedError in place of a numerical failure inside; also a decorator.

    A matrix that is singular or not finite, an iteration of linear algebra that does not converge, an overflow and a division by 0 are
    numerical failures; any other exception is a fault of the program and passes.

    Raises
    ------
    UnresolvedError
        ``what`` must be so that float64 can compute it, with the cause.
    """
    try:
        yield
    except _FAILURES as error:
        raise _unresolved(what, error) from error
    except ValueError as error:
        if _NOT_FINITE not in str(error):
            raise
        raise _unresolved(what, error) from error


def _unresolved(what: str, error: Exception) -> UnresolvedError:
    cause = str(error) or type(error).__name__
    return UnresolvedError(f"{what} must have values here that float64 can compute, got: {cause}")
