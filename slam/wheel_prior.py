"""What is assumed of the wheels before they have told anything."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass


@dataclass(frozen=True)
class WheelPrior:
    """How wrong the wheels' constants may be, beside the noise of each motion: standard deviations.

    forward_scale: of both radii together; turn_scale: of the track; curvature_per_m: heading gained
    on a straight metre by unequal wheels [rad/m]; side_slip_s: metres to the left per metre driven
    and radian turned per second, by which tires give way in a curve [s]; lag_s: by which the body
    follows the wheels, forward and turning, as the speed changes [s]; turn_shift_m: way forward per
    radian turned on the spot, by unequal wheels and tires that creep, another to either side [m];
    lag_noise_s: of each change of speed anew [s]. slips_per_m: how often a wheel slips at all.
    chosen: what a tape measure leaves; a slip of 3 mm/s at 1 m/s and 1 rad/s; a hundredth of a
    second, and a fifth of it for what differs from one change to the next; one slip in 100 m, by
    which logs of real buildings come out best.
    """

    forward_scale: float = 0.01
    turn_scale: float = 0.02
    curvature_per_m: float = 0.02
    side_slip_s: float = 0.003
    lag_s: float = 0.01
    turn_shift_m: float = 0.001
    lag_noise_s: float = 0.002
    slips_per_m: float = 0.01

    def __post_init__(self) -> None:
        """Raises ValueError for what is no deviation: below 0 or not finite."""
        if not all(math.isfinite(value) and value >= 0.0 for value in astuple(self)):
            raise ValueError(f"deviations of wheels must be finite and 0 or more, not {self}")
