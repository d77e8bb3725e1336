"""Whether the robot touches anything but the floor."""

from kitasap_sim import names
from kitasap_sim.robot import SWEPT_HEIGHTS_M
from kitasap_sim.simulation import Simulation


class Bumper:
    """Of the robot in a simulation: it may touch the floor and what lies as low, a bump or a mat.

    What carries it is told by how high it is touched, whatever a place makes its floor of: tires
    meet a wall as high as their axle is, the caster's ball at its middle.
    """

    def __init__(self, simulation: Simulation) -> None:
        model = simulation.model
        base = model.body(names.BASE).id
        self._is_robot = model.body_rootid[model.geom_bodyid] == base
        self._data = simulation.data

    def is_touched(self) -> bool:
        """Whether the robot touches anything else now."""
        contact = self._data.contact
        heights_m = contact.pos[:, 2]
        # of half a dozen, as a rule: sooner told in a list
        if max(heights_m.tolist(), default=0.0) <= SWEPT_HEIGHTS_M[0]:
            return False
        is_high = heights_m > SWEPT_HEIGHTS_M[0]
        is_robot = self._is_robot[contact.geom[is_high]]
        return bool((is_robot[:, 0] != is_robot[:, 1]).any())
