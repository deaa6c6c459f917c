"""`make figures`: run every study against a service of its own and write its figure for the page docs/examples.md."""

from __future__ import annotations

import sys
from pathlib import Path

import servotune
from examples import (
    dc_motor_resistance,
    hanging_load,
    hydraulic_leakage,
    hydraulic_orifice,
    intelligent_damper,
    many_loops,
    mechanical_correction,
    mr_damper,
    pneumatic_motor,
    programmed_delay,
    velocity_limit,
)
from examples.presentation import save

STUDIES = (
    dc_motor_resistance,
    pneumatic_motor,
    hydraulic_leakage,
    hydraulic_orifice,
    mechanical_correction,
    velocity_limit,
    programmed_delay,
    many_loops,
    mr_damper,
    intelligent_damper,
    hanging_load,
)
FIGURES = Path(__file__).parents[1] / "docs" / "figures"


def main() -> int:
    """Write all figures and return the exit code."""
    FIGURES.mkdir(exist_ok=True)
    with servotune.local() as client:
        for script in STUDIES:
            path = FIGURES / f"{script.__name__.rpartition('.')[2].replace('_', '-')}.png"
            print(f"\n{path.name}\n")
            save(script.study(client), path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
