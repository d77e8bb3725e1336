"""How a frame of a film looks: the picture of the robot, the map beside it, and words above."""

import math
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from experiments.film_shots import Shot
from experiments.methods import KnownPlace
from kitasap_sim.robot import KITASAP2
from slam.arrays import FloatArray
from slam.se2 import SE2
from slam.verdict import Status

VIEW_PX = 640, 480
SIZE_PX = 1120, 544
"""Of a frame: multiples of 16, as encoders like them."""
_HEAD_PX, _MAP_PX, _LEGEND_PX = 64, 480, 26
_SCALE = 2
"""The map is drawn so many times as large, and made small again: smooth lines."""
_MARGIN_M = 0.15
TRUTH, ODOMETRY, BELIEVED, CANDIDATE = "#1a1a1a", "#e08214", "#1f6fd0", "#8e44ad"
_WALL, _INK, _PALE, _CLOUD = "#8a8a8a", "#222222", "#777777", "#5d9be0"
_SAYS = {
    Status.TRACKING: ("TRACKING", "#1e8e3e"),
    Status.UNSURE: ("UNSURE", "#b26a00"),
    Status.LOST: ("LOST", "#d01f1f"),
}


KEPT = (TRUTH, ODOMETRY, BELIEVED, CANDIDATE, *(colour for _, colour in _SAYS.values()))
"""Colours that tell something."""


class Frames:
    """Draws the frames of one film, one after the other: trails and clouds grow."""

    def __init__(self, known: KnownPlace, title: str, *, is_mapping: bool = False) -> None:
        self._title, self._is_mapping = title, is_mapping
        lower, upper = known.place.bounds_m + np.array([[-_MARGIN_M], [_MARGIN_M]])
        self._side_px = _SCALE * _MAP_PX
        room_px = self._side_px, self._side_px - _SCALE * _LEGEND_PX
        self._px_per_m = float(min(np.array(room_px) / (upper - lower)))
        # in the middle of what is there
        spare_px = np.array(room_px) - self._px_per_m * (upper - lower)
        self._corner_m = lower - spare_px / 2 / self._px_per_m
        self._floor_px = room_px[1]
        self._paper = Image.new("RGB", (self._side_px, self._side_px), "#ffffff")
        draw = ImageDraw.Draw(self._paper)
        walls = known.true_walls.segments
        for segment in self._px(walls.reshape(-1, 2)).reshape(-1, 2, 2):
            draw.line([tuple(end) for end in segment], fill=_WALL, width=3)
        self._walls = self._paper.copy()
        self._trails: dict[str, list[FloatArray]] = {ODOMETRY: [], BELIEVED: [], TRUTH: []}

    def drawn(self, shot: Shot, view: np.ndarray) -> np.ndarray:
        """(544, 1120, 3) uint8. view: (480, 640, 3), the picture of the robot."""
        frame = Image.new("RGB", SIZE_PX, "#ffffff")
        frame.paste(Image.fromarray(view), (0, _HEAD_PX))
        frame.paste(self._map(shot), (VIEW_PX[0], _HEAD_PX))
        draw = ImageDraw.Draw(frame)
        _text(draw, (12, 6), shot.doing, 24, _INK)
        lapse = f", {shot.lapse} times as fast" if shot.lapse > 1 else ""
        clock = f"{self._title}, t = {shot.moment.time_s:.1f} s{lapse}"
        _text(draw, (12, 38), clock, 16, _PALE)
        spot = 10, SIZE_PX[1] - 24
        draw.text(
            spot, "blue flag: where it believes to be", "#ffffff", _font(16),
            stroke_width=2, stroke_fill="#333333",
        )  # fmt: skip
        left = VIEW_PX[0] + 8
        if self._is_mapping and shot.status is None:
            says, colour = "The robot maps", _INK
        elif shot.status is None:
            says, colour = "The robot looks", _INK
        elif self._is_mapping:
            says, colour = (
                ("MAP GOOD" if shot.status is Status.TRACKING else "MAP FAILED"),
                _SAYS[shot.status][1],
            )
        else:
            says, colour = "The robot says: " + _SAYS[shot.status][0], _SAYS[shot.status][1]
        _text(draw, (left, 6), says, 24, colour)
        _text(draw, (left, 38), shot.words, 16, _PALE, most_px=SIZE_PX[0] - left - 6)
        draw.line([(VIEW_PX[0], _HEAD_PX), (VIEW_PX[0], SIZE_PX[1])], fill="#cccccc", width=2)
        return np.asarray(frame)

    def _map(self, shot: Shot) -> Image.Image:
        if len(shot.cloud_m):
            if shot.is_finished:
                self._paper = self._walls.copy()
            colour, radius = (BELIEVED, 1) if shot.is_finished else (_CLOUD, 0)
            _dots(ImageDraw.Draw(self._paper), self._px(shot.cloud_m), colour, radius)
        image = self._paper.copy()
        draw = ImageDraw.Draw(image)
        true = SE2.from_array(shot.moment.pose)
        poses = {ODOMETRY: shot.odometry, BELIEVED: shot.believed, TRUTH: true}
        for colour, pose in poses.items():
            trail = self._trails[colour]
            trail.append(pose.as_array()[:2])
            draw.line(
                [tuple(p) for p in self._px(np.array(trail))], fill=colour, width=3, joint="curve"
            )
        status_colour = _SAYS[shot.status][1] if shot.status is Status.LOST else BELIEVED
        _dots(draw, self._px(shot.points_m), status_colour, 2)
        for pose in shot.candidates:
            self._robot(draw, pose, CANDIDATE, 1.35, 4)
        self._robot(draw, shot.odometry, ODOMETRY, 1.0, 4)
        self._robot(draw, true, TRUTH, 1.0, 5)
        self._robot(draw, shot.believed, BELIEVED, 0.82, 5)
        draw.rectangle((0, self._floor_px, self._side_px, self._side_px), fill="#ffffff")
        small = image.reduce(_SCALE)
        _legend(ImageDraw.Draw(small), bool(shot.candidates))
        return small

    def _robot(
        self, draw: ImageDraw.ImageDraw, pose: SE2, colour: str, size: float, width: int
    ) -> None:
        """A circle around the robot, with a line to its front."""
        radius_m = size * KITASAP2.radius_m
        x, y = self._px(pose.as_array()[None, :2])[0]
        r = radius_m * self._px_per_m
        draw.ellipse((x - r, y - r, x + r, y + r), outline=colour, width=width)
        front = (x + r * math.cos(pose.theta), y - r * math.sin(pose.theta))
        draw.line([(x, y), front], fill=colour, width=width)

    def _px(self, points_m: FloatArray) -> FloatArray:
        """(N, 2) of points (N, 2) of the world, from the upper left corner of the paper."""
        px = (points_m - self._corner_m) * self._px_per_m
        return np.stack([px[:, 0], self._floor_px - px[:, 1]], axis=1)


def _dots(draw: ImageDraw.ImageDraw, px: FloatArray, colour: str, radius: int) -> None:
    for x, y in np.round(px).astype(int).tolist():
        draw.rectangle((x - radius, y - radius, x + radius, y + radius), fill=colour)


def _legend(draw: ImageDraw.ImageDraw, has_candidates: bool) -> None:
    named = [(TRUTH, "truth"), (ODOMETRY, "odometry"), (BELIEVED, "believed, and its scan")]
    if has_candidates:
        named.append((CANDIDATE, "candidate"))
    x, y = 12, _MAP_PX - _LEGEND_PX + 5
    for colour, name in named:
        draw.ellipse((x, y + 3, x + 11, y + 14), outline=colour, width=3)
        _text(draw, (x + 16, y), name, 15, _INK)
        x += 34 + math.ceil(_font(15).getlength(name))


def _text(
    draw: ImageDraw.ImageDraw,
    at: Sequence[int],
    text: str,
    size_px: int,
    colour: str,
    most_px: int | None = None,
) -> None:
    """One line; too long a one is cut where a word ends."""
    font = _font(size_px)
    if most_px is not None and font.getlength(text) > most_px:
        words = text.split()
        while words and font.getlength(" ".join(words) + " ...") > most_px:
            words.pop()
        text = " ".join(words) + " ..."
    draw.text((at[0], at[1]), text, fill=colour, font=font)


def _font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size_px)
