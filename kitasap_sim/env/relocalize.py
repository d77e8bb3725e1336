"""`Kitasap2/Relocalize-v0`: carried off in a known place: move so that the pose becomes certain."""

from typing import Any, ClassVar

import numpy as np

from kitasap_sim.env.base import KitasapEnv

STEP_COST = 0.01


class RelocalizeEnv(KitasapEnv):
    """Set down anywhere in a place whose map is known: find out where, by moving.

    The simulator does not know what the robot believes: who is to judge it wraps this task.
    `experiments.beliefs.BeliefReward` localises with `slam` on the place's map, observes its
    belief, and ends the episode when the pose is certain. Without it an episode lasts until it is
    truncated.

    ## Action, keywords, observation and info: see `KitasapEnv`

    `place` is "symmetric_room" by default: it looks the same from two sides. So does "twofold", a
    new room in each episode. In any other a robot that stands still is certain of its pose with its
    first scans, as a rule: there is nothing to be chosen.

    ## Reward: the sum of `reward_terms`

    | term | what |
    |---|---|
    | `time` | -0.01 |
    | `collision` | -5 once |

    ## Start, termination, truncation

    Start: at rest, anywhere, any heading; `reset(options={"pose": ..., "place": ...})` sets it.
    Terminated: at a collision. Truncated: after 600 steps (30 s). `is_success` is False without the
    wrapper.
    """

    TERMS: ClassVar[tuple[str, ...]] = ("time", "collision")
    DEFAULT_PLACE: ClassVar[str] = "symmetric_room"

    def _begin(self, options: dict[str, Any]) -> np.ndarray:
        pose = self._checked_pose(options, "pose")
        return self.place.draw_free_pose(self.np_random) if pose is None else pose

    def _rewarded(self) -> tuple[dict[str, float], bool, bool]:
        return {"time": -STEP_COST}, False, False
