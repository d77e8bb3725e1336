"""Lasers with changes: what is not changed stays, and what cannot be is said."""

import numpy as np
import pytest

from kitasap_sim.laser import LASERS, laser


@pytest.mark.parametrize("name", LASERS)
def test_fewer_beams_look_over_the_same_view(name):
    sold, changed = laser(name), laser(f"{name}:beams=60")
    assert changed.beam_count == len(changed.angles_rad) == 60
    assert changed.angles_rad[0] == sold.angles_rad[0]
    ends = sold.angles_rad[-1], changed.angles_rad[-1]
    if sold.beam_count * sold.step_rad > 2 * np.pi - 1e-6:  # all around, each step alike
        ends = sold.beam_count * sold.step_rad, changed.beam_count * changed.step_rad
    assert ends[0] == pytest.approx(ends[1])
    assert changed.name == f"{name}:beams=60"


@pytest.mark.parametrize("name", LASERS)
def test_narrower_view_has_the_beams_of_the_middle_at_their_times(name):
    sold, changed = laser(name), laser(f"{name}:view_deg=71")
    assert np.degrees(np.ptp(changed.angles_rad)) <= 71 + 1e-9
    first = int(np.argmin(np.abs(sold.angles_rad - changed.angles_rad[0])))
    middle = slice(first, first + changed.beam_count)
    np.testing.assert_allclose(changed.angles_rad, sold.angles_rad[middle], atol=1e-12)
    if sold.interlace == 1 or first % sold.interlace == 0:
        np.testing.assert_allclose(changed.delays_s(), sold.delays_s()[middle], atol=1e-12)


def test_noise_is_a_factor_and_numbers_are_set():
    changed = laser("urg_04lx:range_noise=2:dropout_rate=0.25:range_max_m=3:interlace=1")
    sold = laser("urg_04lx")
    at_m = np.array([0.5, 2.0, 4.0])
    np.testing.assert_allclose(changed.sigma_m(at_m), 2 * sold.sigma_m(at_m))
    assert (changed.dropout_rate, changed.range_max_m, changed.interlace) == (0.25, 3.0, 1)
    assert laser("urg_04lx") is LASERS["urg_04lx"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            "foo=1",
            "'foo=1' is no change field=value of these fields: beams, view_deg, range_noise, ",
        ),
        ("", "'' is no change"),
        ("beams", "'beams' is no change"),
        ("name=x", "'name=x' is no change"),
        ("beams=x", "beams is a whole number from 2 on, not 'x'"),
        ("beams=1", "beams is a whole number from 2 on, not '1'"),
        ("range_noise=0", "range_noise is a factor above 0, not 0"),
        ("range_noise=nan", "range_noise is a finite number, not 'nan'"),
        ("view_deg=300", "view_deg lies between 0.352 and 239.41, its own, not at 300"),
        ("is_clockwise=2", "is_clockwise is True or False, not 2"),
        ("dropout_rate=2", "rates lie between 0 and 1"),
        ("beam_count=5000", "are more than a full turn"),
    ],
)
def test_change_that_cannot_be_is_refused(changes, said):
    with pytest.raises(ValueError, match=r"^laser urg_04lx") as raised:
        laser(f"urg_04lx:{changes}")
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)
