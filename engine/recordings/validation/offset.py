"""Is it a constant?   e - mean e, the zero of a sensor."""

from __future__ import annotations

from engine.recordings.validation.comparison import Comparison
from engine.recordings.validation.remedy import Remedy, worthwhile


def offset(comparison: Comparison) -> Remedy | None:
    """Return the constant that the residual holds; None where there is none, or it is estimated already."""
    if comparison.constant:
        return None
    constant = float(comparison.residual.mean())
    left = comparison.relative_error(comparison.residual - constant)
    if left is None or not worthwhile(left, comparison.present_error):
        return None
    return Remedy(
        kind="offset",
        relative_error_percent=left,
        values={"offset": constant},
        sentence=(
            f"{comparison.name} lies {abs(constant):.4g} {'above' if constant > 0 else 'below'} the model throughout: the zero of a sensor; "
            'give this offset, or let it be estimated (offsets: "estimate").'
        ),
    )
