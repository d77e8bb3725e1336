"""The laser as MJCF: one site and one <rangefinder> for each beam, each firing at its own instant.

`python -m kitasap_sim.fan` writes the default laser's fan into `models/kitasap2/kitasap2.xml`
anew. The fan is written out because `<replicate>` takes seconds to parse at this size.
"""

import re
from pathlib import Path

import numpy as np

from kitasap_sim import names
from kitasap_sim.laser import LaserSpec, laser

_BEAM_LINE = re.compile(r"^ *<(?:site|rangefinder) name=\"lrs_\d{4}\".*\n", re.MULTILINE)
_LASER_SITE = re.compile(r"^( *)<site name=\"laser\".*\n", re.MULTILINE)
_SENSOR_END = re.compile(r"^( *)</sensor>", re.MULTILINE)


def with_fan(robot_xml: str, spec: LaserSpec | None, axle_height_m: float) -> str:
    """The robot's MJCF with this laser's beams in place of those it has; None leaves it without.

    axle_height_m: of the robot's frame above the floor, which `mount_m` counts from [m].
    """
    bare_xml = _BEAM_LINE.sub("", robot_xml)
    if spec is None:
        return bare_xml
    x, y, z = spec.mount_m
    pos = f"{x:.6g} {y:.6g} {z - axle_height_m:.6g}"
    laser_site = _LASER_SITE.search(bare_xml)
    sensor_end = _SENSOR_END.search(bare_xml)
    if laser_site is None or sensor_end is None:
        raise ValueError("the robot's MJCF has no site 'laser' or no <sensor> section")
    indent = laser_site.group(1)
    site = f'{indent}<site name="laser" pos="{pos}" size="0.004" group="4"/>\n'
    return "".join(
        [
            bare_xml[: laser_site.start()],
            site,
            *_sites(spec, pos, indent),
            bare_xml[laser_site.end() : sensor_end.start()],
            *_rangefinders(spec, sensor_end.group(1) + "  "),
            bare_xml[sensor_end.start() :],
        ]
    )


def _sites(spec: LaserSpec, pos: str, indent: str) -> list[str]:
    """A site's ray leaves along its own z axis."""
    return [
        f'{indent}<site name="{names.beam(i)}" class="beam" pos="{pos}" '
        f'zaxis="{np.cos(angle):.15f} {np.sin(angle):.15f} 0"/>\n'
        for i, angle in enumerate(spec.angles_rad)
    ]


def _rangefinders(spec: LaserSpec, indent: str) -> list[str]:
    """interval = "period phase", phase being when the beam would have fired before time 0.

    0 as phase has the special meaning of -period, which is what a beam without delay needs.
    """
    phases_s = np.where(spec.delays_s() > 0, spec.delays_s() - spec.period_s, 0.0)
    return [
        f'{indent}<rangefinder name="{names.beam(i)}" site="{names.beam(i)}" '
        f'nsample="1" interval="{spec.period_s:.12g} {phase:.12g}"/>\n'
        for i, phase in enumerate(phases_s)
    ]


def main() -> None:
    """Writes the default laser's fan into the robot's file."""
    from kitasap_sim.robot import KITASAP2, ROBOT_XML

    path = Path(str(ROBOT_XML))
    path.write_text(with_fan(path.read_text(), laser("urg_04lx"), KITASAP2.axle_height_m))


if __name__ == "__main__":
    main()
