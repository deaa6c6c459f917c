"""What continuous and discrete notches share: their parameters."""

from __future__ import annotations

from engine.model.parameters import Param

NOTCH = (
    Param(
        name="frequency", symbol="w", unit="rad/s", lower=0.0, lower_open=True, scale="log",
        doc="centre of the notch",
    ),
    Param(
        name="depth", symbol="g", unit="1", default=0.0, lower=0.0, upper=1.0,
        doc="gain that is left at the centre: 0 blocks it, 1 changes nothing",
    ),
    Param(
        name="width", symbol="B", unit="1", default=1.0, lower=0.0, lower_open=True, scale="log",
        doc="distance of the two -3 dB frequencies of a full notch over the centre: twice the damping of the poles",
    ),
)  # fmt: skip
