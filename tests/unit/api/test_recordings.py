from __future__ import annotations

import pytest

from api.problems.documents import Problem
from api.services.recordings.recordings import check_lengths


def test_channels_of_different_length_do_not_belong_together() -> None:
    names = {("inputs", "u"): "command", ("outputs", "y"): "position"}
    check_lengths({"command": 10, "position": 10}, names)
    with pytest.raises(Problem, match="'position' must have 10 samples as 'command' has, got 9") as caught:
        check_lengths({"command": 10, "position": 9}, names)
    assert caught.value.status == 422
    assert caught.value.faults[0].place == ("outputs", "y")
