"""What a point is worth by the noise of its range."""

import pytest

from slam.range_noise import RangeNoise

URG = RangeNoise(((1.0, 0.010), (5.6, 0.056)))


def test_sigma_lies_on_straight_lines_between_the_points_and_is_constant_outside():
    assert URG.sigma_m([0.1, 1.0, 3.0, 9.0]) == pytest.approx([0.010, 0.010, 0.030, 0.056])


def test_points_of_surer_ranges_count_more_up_to_four_times():
    repeats = URG.repeats([0.5, 1.0, 2.0, 3.0, 5.0])
    # the median noise is 2 cm: twice that point, four times what is surer, once what is less sure
    assert repeats.tolist() == [4, 4, 2, 1, 1]


def test_where_the_noise_is_the_same_everywhere_all_points_count_once():
    assert RangeNoise(((1.0, 0.005),)).repeats([1.0, 5.0, 8.0]).tolist() == [1, 1, 1]
    assert URG.repeats([]).shape == (0,)


def test_impossible_noise_is_refused():
    with pytest.raises(ValueError, match="increasing ranges"):
        RangeNoise(((2.0, 0.01), (1.0, 0.02)))
    with pytest.raises(ValueError, match="increasing ranges"):
        RangeNoise(())
    with pytest.raises(ValueError, match="above 0"):
        RangeNoise(((1.0, 0.0),))
