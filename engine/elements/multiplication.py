"""Product of signals, or quotient.

y = u1 ·/÷ u2 ·/÷ ...
"""

from __future__ import annotations

from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Mode, Moment, NonlinearElement, Signals
from engine.model.errors import DiagramError
from engine.model.parameters import Param

MAX_INPUTS = 64


class Multiplication(NonlinearElement):
    """Signals multiplied (``*``) or divided by (``/``): a gain that another signal schedules, power, modulation."""

    kind = "multiplication"
    title = "Multiplication"
    equation = "y = in1 */÷ in2 */÷ ..."
    source = "Definition."
    note = "a product has the slope of each factor at the operating point of the others"
    parameters = (
        Param(
            name="operations", symbol="·", shape="text", default="**",
            doc="one character for each input: * multiplies, / divides",
        ),
    )  # fmt: skip
    example = {"operations": "**"}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse anything but 1 to 64 operations."""
        operations = values["operations"]
        if not 1 <= len(operations) <= MAX_INPUTS or set(operations) - {"*", "/"}:
            raise DiagramError(
                f"operations must be 1 to {MAX_INPUTS} characters * or /, got '{operations[:80]}'", at=("operations",)
            )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return an input for each operation."""
        return Ports(inputs=tuple(f"in{i + 1}" for i in range(len(values["operations"]))))

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the product."""
        product = 1.0
        for operation, factor in zip(values["operations"], m.z, strict=True):
            product = product * factor if operation == "*" else product / factor
        return [product]
