"""What can be wrong with a system document, said with the place where it is wrong.

::

    EngineError
    ├── DiagramError      a block, port, connection, parameter or size
    ├── ExpressionError   a parameter expression
    ├── SignalError       a command signal
    ├── MaskError         bounds on a curve
    ├── SpectrumError     a spectrum that cannot be had of this signal
    ├── ProcessingError   a step that a recording cannot take
    ├── IllPosedError     an algebraic loop without a solution
    └── UnresolvedError   a response beyond the limits of resolution
"""

from __future__ import annotations

Path = tuple[str | int, ...]


class EngineError(Exception):
    """A document that the engine refuses.

    Parameters
    ----------
    message : str
        ``<name> must be <rule> <unit>, got <value>``.
    at : tuple of str or int
        Path from the root of the document, e.g. ``("blocks", "motor", "area")``.
    """

    def __init__(self, message: str, *, at: Path = ()) -> None:
        super().__init__(message)
        self.message = message
        self.at = at

    def __str__(self) -> str:
        return self.message

    def of(self, name: str) -> EngineError:
        """Return this error with ``name``, whose error it is, put before its message."""
        self.message = f"{name}: {self.message}"
        return self

    def within(self, *prefix: str | int) -> EngineError:
        """Return this error with ``prefix`` put before its path."""
        self.at = (*prefix, *self.at)
        return self


class DiagramError(EngineError):
    """A block, port, connection, parameter or size is wrong."""


class ExpressionError(EngineError):
    """A parameter expression cannot be read or evaluated."""


class SignalError(EngineError):
    """A command signal's parameters are wrong; ``at`` counts from the signal."""


class MaskError(EngineError):
    """Bounds on a curve are wrong; ``at`` counts from the bounds."""


class SpectrumError(EngineError):
    """A spectrum cannot be had of this signal with these settings; ``at`` names the setting.

    ``verdict`` is that of an output which does not settle, an empty word elsewhere.
    """

    def __init__(self, message: str, *, at: Path = (), verdict: str = "") -> None:
        super().__init__(message, at=at)
        self.verdict = verdict


class ProcessingError(EngineError):
    """A processing step has wrong numbers, or a recording cannot take it; ``at`` names the setting."""


class IllPosedError(EngineError):
    """An algebraic loop has no (unique) solution; ``ports`` names the outputs on it."""

    def __init__(self, message: str, *, at: Path = (), ports: tuple[str, ...] = ()) -> None:
        super().__init__(message, at=at)
        self.ports = ports


class UnresolvedError(EngineError):
    """A response cannot be resolved within the limits (a very lightly damped or very stiff system, say)."""
