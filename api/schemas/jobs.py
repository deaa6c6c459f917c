"""What requests about recordings share: windows of time, and which channel belongs to which port."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from api.schemas.values import Path, Quantity

Window = Annotated[list[Quantity], Field(min_length=2, max_length=2, description="[t0, t1] in s")]
Channels = Annotated[dict[Path, str], Field(min_length=1, max_length=50)]
