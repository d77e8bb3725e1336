"""Places written by a program: blocks and pillars as MJCF, for maps and floor plans made solid."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from kitasap_sim import names
from kitasap_sim.place_look import ASSETS_XML, LIGHTS_XML, OPTION_XML, VISUAL_XML

_OVERLAP_M = (1e-7, 2e-7)
"""By so much blocks reach beyond their sides, along x and y: a beam along the seam of two that only
touch may pass between them by rounding, and one along a square's diagonal through its corners. Far
below any laser, far above rounding."""
_TILT_RAD = math.atan(0.5)
_LEAST_FLOOR_M = 1.0

_FRAME_XML = f"""\
<mujoco model={{name}}>
  <!-- {{source}} -->
{OPTION_XML}
{VISUAL_XML}  <statistic center="{{middle_x}} {{middle_y}} .4" extent="{{extent}}"/>

  <default>
    <default class="wall">
      <geom rgba=".93 .91 .86 1"/>
    </default>
    <default class="furniture">
      <geom rgba=".80 .64 .44 1"/>
    </default>
  </default>

{ASSETS_XML}
  <worldbody>
{LIGHTS_XML}    <camera name="overview" pos="{{middle_x}} {{camera_y}} {{camera_z}}" quat="{{camera_w}} {{camera_i}} 0 0"/>
    <geom name="floor" type="plane" size="{{floor_x}} {{floor_y}} .1" pos="{{middle_x}} {{middle_y}} 0" material="floor"/>
{{start}}{{geoms}}  </worldbody>
</mujoco>
"""


@dataclass(frozen=True)
class Block:
    """A box that stands on the floor: its middle, its sides along its own axes, how it is turned.

    name: None for a wall, which nobody pushes aside.
    """

    x_m: float
    y_m: float
    width_m: float
    depth_m: float
    height_m: float
    heading_rad: float = 0.0
    name: str | None = None

    def reach_m(self) -> tuple[float, float]:
        """How far it reaches from its middle along x and y."""
        c, s = abs(math.cos(self.heading_rad)), abs(math.sin(self.heading_rad))
        half_x, half_y = self.width_m / 2, self.depth_m / 2
        return c * half_x + s * half_y, s * half_x + c * half_y

    def geom(self) -> str:
        """Its line of MJCF."""
        half_x, half_y = self.width_m / 2 + _OVERLAP_M[0], self.depth_m / 2 + _OVERLAP_M[1]
        turned = f' euler="0 0 {_text(self.heading_rad)}"' if self.heading_rad else ""
        size = f"{_text(half_x)} {_text(half_y)} {_text(self.height_m / 2)}"
        return _geom("box", self.name, self.x_m, self.y_m, self.height_m, size, turned)


@dataclass(frozen=True)
class Pillar:
    """An upright cylinder on the floor. name: None for one that is built in."""

    x_m: float
    y_m: float
    radius_m: float
    height_m: float
    name: str | None = None

    def reach_m(self) -> tuple[float, float]:
        """How far it reaches from its middle along x and y."""
        return self.radius_m, self.radius_m

    def geom(self) -> str:
        """Its line of MJCF."""
        size = f"{_text(self.radius_m)} {_text(self.height_m / 2)}"
        return _geom("cylinder", self.name, self.x_m, self.y_m, self.height_m, size, "")


def place_mjcf(
    name: str,
    source: str,
    solids: Sequence[Block | Pillar],
    start: tuple[float, float, float] | None,
    frame: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> str:
    """The MJCF file of a place made of blocks and pillars, with a floor under all of them.

    start: x, y [m] and heading [rad] of the site `start`, in the world; None leaves it out. frame: pose in the world of
    the frame that the solids are given in. source: a comment on what it was made of.
    Raises ValueError if there are no solids.
    """
    if not solids:
        raise ValueError("a place needs something that stands on its floor")
    reach = [(solid.x_m, solid.y_m, *solid.reach_m()) for solid in solids]
    low_x, high_x = min(x - a for x, _, a, _ in reach), max(x + a for x, _, a, _ in reach)
    low_y, high_y = min(y - b for _, y, _, b in reach), max(y + b for _, y, _, b in reach)
    c, s = math.cos(frame[2]), math.sin(frame[2])
    x, y = (low_x + high_x) / 2, (low_y + high_y) / 2
    middle_x, middle_y = frame[0] + c * x - s * y, frame[1] + s * x + c * y
    width_m = abs(c) * (high_x - low_x) + abs(s) * (high_y - low_y)
    depth_m = abs(s) * (high_x - low_x) + abs(c) * (high_y - low_y)
    far_m = 1.3 * max(width_m, depth_m)
    numbers = {
        **{"middle_x": middle_x, "middle_y": middle_y, "extent": 0.8 * max(width_m, depth_m)},
        **{"camera_y": middle_y - 0.5 * far_m, "camera_z": far_m},
        **{"camera_w": math.cos(_TILT_RAD / 2), "camera_i": math.sin(_TILT_RAD / 2)},
        **{"floor_x": width_m / 2 + _LEAST_FLOOR_M, "floor_y": depth_m / 2 + _LEAST_FLOOR_M},
    }
    return _FRAME_XML.format(
        name=quoteattr(name),
        source=" ".join(source.split()).replace("--", "- "),
        start="" if start is None else f"    {_site(*start)}\n",
        geoms=_in_frame([solid.geom() for solid in solids], frame),
        **{key: _text(number) for key, number in numbers.items()},
    )


def _in_frame(geoms: Sequence[str], frame: tuple[float, float, float]) -> str:
    """Lines of the worldbody. Without a frame where none is needed: what stands in the worldbody
    itself can be pushed aside."""
    if frame == (0.0, 0.0, 0.0):
        return "".join(f"    {geom}\n" for geom in geoms)
    pos, heading = f"{_text(frame[0])} {_text(frame[1])} 0", _text(frame[2])
    inside = "".join(f"      {geom}\n" for geom in geoms)
    return f'    <frame pos="{pos}" euler="0 0 {heading}">\n{inside}    </frame>\n'


def _site(x_m: float, y_m: float, heading_rad: float) -> str:
    pos, heading = f"{_text(x_m)} {_text(y_m)} 0", _text(heading_rad)
    return f'<site name="{names.START}" pos="{pos}" euler="0 0 {heading}" size=".02 .02 .02"/>'


def _geom(
    kind: str, name: str | None, x_m: float, y_m: float, height_m: float, size: str, turned: str
) -> str:
    marks = 'class="wall"' if name is None else f'name={quoteattr(name)} class="furniture"'
    pos = f"{_text(x_m)} {_text(y_m)} {_text(height_m / 2)}"
    return f'<geom {marks} type="{kind}" pos="{pos}" size="{size}"{turned}/>'


def _text(number: float) -> str:
    """Nine decimals: a hundredth of the overlap of blocks."""
    return f"{number:.9f}".rstrip("0").rstrip(".")
