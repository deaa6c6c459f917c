"""All that is compiled ahead: of a machine once, a minute or two; from then on it is loaded in about a second."""

from __future__ import annotations

from engine.batch.kernels import warm as kernels
from engine.batch.linear import warm as responses
from engine.batch.sampled_data import warm as sampled_data


def compiled_before() -> bool:
    """Return whether a process of this machine has compiled all of it as it is now."""
    return bool(kernels.MARK and responses.MARK and sampled_data.MARK)


def warm() -> None:
    """Compile it, or load what was compiled."""
    for part in (kernels, responses, sampled_data):
        part.warm()


if __name__ == "__main__":
    warm()
