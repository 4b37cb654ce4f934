"""The clock waits if samples are early, and never catches up if they are late."""

import pytest

from rnc_pin.applications.drive.run import RealTimeClock


class Hours:
    """Time that passes only by sleeping and working."""

    def __init__(self):
        self.now, self.slept = 100.0, 0.0

    def sleep(self, duration):
        self.now += duration
        self.slept += duration


def work(clock, hours, samples, duration):
    for k in samples:
        clock.wait(0.01 * k)
        hours.now += duration


def test_early_samples_wait_for_real_time():
    hours = Hours()
    clock = RealTimeClock(lambda: hours.now, hours.sleep)
    work(clock, hours, range(101), 0.004)
    assert (hours.now, hours.slept) == (pytest.approx(101.004), pytest.approx(0.6))
    assert clock.factor == pytest.approx(1.0)


def test_late_samples_slow_the_run_down_and_are_not_made_up_for():
    hours = Hours()
    clock = RealTimeClock(lambda: hours.now, hours.sleep)
    work(clock, hours, range(101), 0.02)
    assert (hours.slept, clock.factor) == (0.0, pytest.approx(0.5))
    before = hours.now
    work(clock, hours, range(101, 301), 0.001)
    assert hours.now - before >= 1.98  # real time again, not faster
    assert clock.factor == pytest.approx(1.0, abs=0.02)
