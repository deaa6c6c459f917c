"""No sample of a drive exceeds the limits of its output."""

from __future__ import annotations

import numpy as np
import pytest

from agent.errors import AttemptError
from agent.safety import Drive, way_home
from agent.settings import OutputSettings


def drive(signal=lambda t: np.full_like(t, 2.0), *, rate=1000.0, wait=100, length=1000, repeats=1, **limits) -> Drive:
    output = OutputSettings(**{"name": "valve", "channel": "Dev1/ao0", "amplitude": 5.0, **limits})
    return Drive(signal=signal, output=output, rate=rate, wait=wait, length=length, repeats=repeats)


def test_it_waits_plays_and_comes_home() -> None:
    made = drive(soft_start=0.1, soft_stop=0.2, safe=0.5)
    u = made.block(0, made.samples)
    assert u.shape == (1100,)
    assert np.all(u[:101] == 0.5)
    # Half of the soft start, of the way from 0.5 to 2: 0.5 - 0.5 cos(pi / 2) = 1/2.
    assert u[150] == pytest.approx(0.5 + 0.5 * 1.5)
    assert np.all(u[200:900] == 2.0)
    assert u[-1] == 0.5
    assert np.abs(np.diff(u)).max() < 1.5 * np.pi / 2 / 100 * 1.01  # the steepest of a half cosine over 0.1 s


def test_blocks_are_the_whole() -> None:
    made = drive(lambda t: np.sin(40 * t), soft_start=0.3, repeats=3)
    whole = made.block(0, made.samples)
    assert np.array_equal(np.concatenate(list(made.blocks(size=77))), whole)
    assert np.array_equal(whole[400 + 1000 : 1099 + 1000], whole[400 + 2000 : 1099 + 2000])  # but for the way home


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"amplitude": 1.9}, "must stay within 1.9 V, got 2"),
        ({"duration": 0.9}, "must last at most 0.9 s, got 1"),
        ({"slew": 1999.0}, "must change by at most 1999 V/s, got 2000"),  # 2 V within one sample of 1 ms
    ],
)
def test_limits_are_kept(limits, says) -> None:
    with pytest.raises(AttemptError, match=says) as refused:
        drive(**limits).check()
    assert refused.value.code == "drive_limit"
    drive(amplitude=2.0, duration=1.0, slew=2000.0).check()


def test_coming_home_counts_as_moving() -> None:
    """A drive that ends high falls to its safe value in one sample, unless it has a soft stop."""
    late = lambda t: np.minimum(t * 4, 2.0)  # noqa: E731
    with pytest.raises(AttemptError, match="must change by at most 100 V/s"):
        drive(late, slew=100.0).check()
    drive(late, slew=100.0, soft_stop=0.1).check()


def test_a_drive_that_is_no_number_is_refused() -> None:
    with pytest.raises(AttemptError, match="must be finite"):
        drive(lambda t: np.where(t > 0.5, np.nan, 0.0)).check()


def test_the_way_home_is_no_faster_than_allowed() -> None:
    output = OutputSettings(name="valve", channel="Dev1/ao0", amplitude=5.0, slew=20.0, soft_stop=0.05, safe=-1.0)
    way = way_home(output, 3.0, 1000.0)
    assert way[-1] == -1.0
    assert np.abs(np.diff(way, prepend=3.0)).max() * 1000 <= 20.0 * (1 + 1e-6)
    # 4 V at 20 V/s, of a half cosine whose middle is pi/2 times steeper than its mean.
    assert way.size == pytest.approx(4 / 20 * np.pi / 2 * 1000, abs=5)


def test_a_drive_that_just_reaches_its_limit_is_not_refused_for_its_rounding() -> None:
    """From a safe value near -1.0025 V, 3 V come out of the soft start as the next number above 3: a driver refuses that."""
    safe = -1.002506561347571
    assert safe + 1.0 * (3.0 - safe) > 3.0
    made = drive(lambda t: np.full_like(t, 3.0), amplitude=3.0, safe=safe, soft_start=0.02, soft_stop=0.02)
    made.check()
    assert made.block(0, made.samples).max() == 3.0
