from __future__ import annotations

import numpy as np
import pytest

from api.convert.recordings import envelope, physical
from api.problems.documents import Problem
from api.services.recordings.recordings import check_lengths


def test_channels_of_different_length_do_not_belong_together() -> None:
    names = {("inputs", "u"): "command", ("outputs", "y"): "position"}
    check_lengths({"command": 10, "position": 10}, names)
    with pytest.raises(Problem, match="'position' must have 10 samples as 'command' has, got 9") as caught:
        check_lengths({"command": 10, "position": 9}, names)
    assert caught.value.status == 422
    assert caught.value.faults[0].place == ("outputs", "y")


def test_a_zero_keeps_its_sign_unless_an_offset_moves_it() -> None:
    raw = np.array([-0.0, 0.0])
    for channel in ({}, {"scale": 2.0}, {"scale": 1.0, "offset": 0.0}):
        for values in (physical(raw, channel), *envelope(raw, raw, channel)):
            assert np.signbit(values).tolist() == [True, False]
    assert physical(raw, {"offset": 0.5}).tolist() == [0.5, 0.5]
