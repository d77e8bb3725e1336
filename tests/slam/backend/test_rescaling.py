"""Steps by the wheels' scale that is known in the end."""

from __future__ import annotations

import numpy as np

from slam.backend.rescaling import rescaled
from slam.beams import Beams
from slam.frontend.keyframes import Keyframe
from slam.frontend.told_steps import ToldStep
from slam.frontend.wheel_scale import ScaledStep
from slam.se2 import SE2


def test_step_moves_by_as_much_of_it_as_the_wheels_told_and_what_they_told_by_all():
    nothing, told = Beams(np.empty((0, 2)), np.empty(0), np.empty(0)), SE2(0.9, 0.1, 0.2)
    keyframe = Keyframe(
        0.0, SE2.identity(), SE2(1.0, 0.1, 0.2), np.eye(3), np.empty((0, 2)), nothing, False,
        told=ToldStep(told, np.eye(3)),
    )  # fmt: skip
    step = ScaledStep(0.9, np.array([0.5, 0.0, 0.0]))
    before, first, later = rescaled([keyframe] * 3, [step] * 2, 1.08)
    assert before is first is keyframe
    assert later.T_before == SE2(1.0, 0.1, 0.2) @ SE2(0.18 * 0.5, 0.0, 0.0)
    assert np.allclose(later.told.motion.as_array(), [1.08, 0.12, 0.2])
