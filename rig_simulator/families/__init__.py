"""Device families as NI's documents describe them: a table, each row with its sources."""

from __future__ import annotations

from rig_simulator.families import boards, chassis, modules
from rig_simulator.families._base import Clock, Family

FAMILIES = {row.model: row for row in (*chassis.ROWS, *modules.ROWS, *boards.ROWS)}
"""Model -> row."""

DEFAULT_CHASSIS = FAMILIES["cDAQ-9178"]
"""Of modules whose chassis nobody has described."""

__all__ = ["DEFAULT_CHASSIS", "FAMILIES", "Clock", "Family"]
