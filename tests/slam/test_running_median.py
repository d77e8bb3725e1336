import statistics

import numpy as np
import pytest

from slam.running_median import RunningMedian


def test_median_is_that_of_the_last_values_however_many_are_alike():
    values = np.random.default_rng(3).integers(0, 6, size=60).astype(float).tolist()
    running = RunningMedian(7)
    for count, value in enumerate(values, start=1):
        running.take(value)
        last = values[max(0, count - 7) : count]
        assert (len(running), running.median) == (len(last), statistics.median(last))


def test_median_of_nothing_is_an_error():
    with pytest.raises(IndexError):
        _ = RunningMedian(7).median


def test_a_value_that_is_no_number_leads_nowhere_beyond_those_kept():
    running = RunningMedian(4)
    for value in (1.0, np.nan, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0):
        running.take(value)
    assert len(running) == 4
