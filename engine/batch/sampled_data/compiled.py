"""How the functions of this folder are compiled."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from engine.batch.linear.compiled import HOME as RESPONSES
from engine.batch.linear.compiled import Compiler

_COMPILER = Compiler("sampled", Path(__file__).parent, RESPONSES)
HOME: Final = _COMPILER.home
compiled, allocating = _COMPILER.compiled, _COMPILER.allocating
