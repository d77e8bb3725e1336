"""How the front end of mapping places scans."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from slam.beams import POINTS_WITHIN_M
from slam.frontend.pauses import PauseConfig
from slam.frontend.wheel_scale import WheelScaleConfig
from slam.surface.surface_map import SurfaceMapConfig


@dataclass(frozen=True)
class DenialConfig:
    """What the last keyframes deny of a scan, and it of them.

    witnesses: so many of them. margins, in metres and as a share, and aside_m: by which beams end
    beyond what they went through, as in `contradictions`. most: share of what they have in view of one
    another that was looked through, of a scan that is borne out: then it lies where wheels lead that are
    sure (m, rad), though it fits worse than usual, but for doubtful_ratio, or they led far. Of 2256
    scans of aces with a third of them lost 99 % have 0.11 or less, of 1047 taken elsewhere 0.07 or more.
    more: share by which a pose that the wheels contradict may be denied more than where they lead, of
    14 that were metres off 0.03 to 0.26; and by which less, for a little better to be enough. Chosen,
    all of these.
    """

    witnesses: int = 3
    margins: tuple[float, float] = (0.15, 0.02)
    aside_m: float = 0.1
    most: float = 0.05
    more: tuple[float, float] = (0.02, 0.1)
    sure: tuple[float, float] = (0.6, 0.2)
    doubtful_ratio: float = 0.4


@dataclass(frozen=True)
class FrontEndConfig:
    """How a `FrontEnd` places scans.

    window: keyframes that the surfaces are learnt from. keyframe_m, keyframe_rad: motion after
    which a scan becomes one. step_sigma: (m, m, rad) of each step beside what the odometry says of
    itself. good_inlier_ratio: below it, the scan is looked for where the wheels count less, by
    trust of their normalised innovation squared, and all around, within about reach_m and reach_rad;
    lost_m, lost_reach_m: where wheels leave open more than the first, standard deviation, within twice that and the
    second at most, and a scan must fit as well as where nothing tells how far the robot went: wheels of aces that
    stood for 10 s led scans to where 0.82 and 0.85 of them fitted, 2.2 and 1.3 m short of where they lay;
    surely_wrong: of the same, over scans that told nothing, beyond which they had jumped: in ten seconds
    of turns mit-csail's were off by 20, little by little;
    guess_inlier_ratio: in its place where nothing tells how far the robot went: a metre along a wall
    off, 0.85 of a scan fitted still.
    least_inlier_ratio, least_seen_ratio: below either, no pose is believed; against: nor one that fits
    so much and that the wheels contradict by more than that, of their normalised innovation squared:
    of 41 that they contradicted at all in logs of aces and mit-csail with a third of their scans lost,
    three were wrong, with 0.72 and less and 70 and more; 38 right ones had 0.78 and more, or 32 and less. better: cost by which a
    pose found around must be better; better_guess: one near the last, where wheels lead that know next
    to nothing: of eight jumps along corridors 0.02 and more; better_against: one that the wheels contradict: odometry that
    jumped makes it 0.27 to 0.8, the next door 0.03 to 0.2; most_off_m: farther from where wheels lead that know of the way, none is. break_sigma: (m, m, rad) by which the
    wheels may be wrong where the scans broke off. min_points: fewer, farther than blocked_m from the laser, tell
    nothing: somebody stands before it. least_begun: points of a scan that begins a new piece where
    scans broke off: fewer, among trees, fit what they should not, and against the wheels are believed
    nothing. blind_m: by the wheels alone;
    after more than the first, a scan that fits may be one that looks the same, unless it is borne out,
    after more than the second any; guess_blind_m: where wheels are no more than a guess; fastest_mps:
    wheels that tell of more have jumped. least_facing: share of a scan across a direction, below
    which it leaves that open: a tenth of the least of five real logs but for one corridor. ample_facing:
    with less of it, where nothing but scans tells of the way, it must fit in one place alone: recesses
    alike, each 1 to 1.5 m, had 0.004 to 0.01, a turn in a corridor of intel 0.025.
    pause_inlier_ratio: of the scan after a pause that must fit for the robot to be where it was; 0.94
    and more did on the same logs, of robots carried into the next room 0.77 to 0.86 in four cases of
    five.
    most_passed: share of what a keyframe shortly before shows in view of the scan, of at least
    min_points, that its beams went through: then the scan is taken elsewhere, however well it fits;
    of five real logs 0.36 and less, among four who walk along 0.66.
    range_max_m: farther ends of beams are left out. Chosen, all of these.
    """

    surfaces: SurfaceMapConfig = field(default_factory=SurfaceMapConfig)
    wheel_scale: WheelScaleConfig = field(default_factory=WheelScaleConfig)
    window: int = 25
    keyframe_m: float = 0.25
    keyframe_rad: float = math.radians(12.0)
    step_sigma: tuple[float, float, float] = (0.01, 0.01, 0.01)
    good_inlier_ratio: float = 0.85
    guess_inlier_ratio: float = 0.95
    trust: float = 20.0
    surely_wrong: float = 60.0
    reach_m: float = 0.8
    reach_rad: float = math.radians(50.0)
    lost_m: float = 1.5
    lost_reach_m: float = 6.0
    least_inlier_ratio: float = 0.65
    least_seen_ratio: float = 0.3
    against: tuple[float, float] = (0.75, 40.0)
    better: float = 0.03
    better_guess: float = 0.01
    better_against: float = 0.24
    most_off_m: float = 1.5
    break_sigma: tuple[float, float, float] = (0.5, 0.5, 0.3)
    min_points: int = 20
    least_begun: int = 40
    blocked_m: float = 0.6
    blind_m: tuple[float, float] = (5.0, 8.0)
    guess_blind_m: float = 2.0
    fastest_mps: float = 10.0
    least_facing: float = 0.003
    ample_facing: float = 0.015
    pauses: PauseConfig = field(default_factory=PauseConfig)
    pause_inlier_ratio: float = 0.9
    denial: DenialConfig = field(default_factory=DenialConfig)
    most_passed: float = 0.75
    range_max_m: float = POINTS_WITHIN_M
