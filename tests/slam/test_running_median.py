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
