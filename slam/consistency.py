"""Whether map, laser and wheels are as assumed: what innovations and residuals say of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from slam.range_noise import RangeNoise
from slam.scan_match import RangeFit

_MEMORY = 50
"""Chosen: about five seconds of scans count."""
_LEAST_OFFSET_M = 0.001
_MOST_NIS = 25.0
"""One slip of a tire is no trend: it counts as so much at most."""
_LEAST = 30
"""Chosen: no word on trends before so many scans."""
_LEAST_SIGMA_M = 0.001
"""As small a noise as `kitasap localize` takes; ranges without any, of a simulation, scatter less."""
_CHECK = "check where the laser sits (of a log: --mount), and the wheels' radii and track"


@dataclass
class InnovationMonitor:
    """Running means over the latest scans, and the warnings that follow from them.

    Each names what was expected, what came and what to look at. Limits are chosen so that scans as
    assumed, people among them, pass: means over 50 scans, each limit many deviations away.
    """

    nis_limit: float = 6.0
    scale_limits: tuple[float, float] = (0.75, 1.3)
    offset_limit_sigmas: float = 4.0
    strain_limit: float = 4.0
    missing_limit: float = 0.005
    count: int = 0
    _nis: float = 0.0
    _scale: float = 0.0
    _offset_information: float = 0.0
    _offset_pull: float = 0.0
    _strain: float = 0.0
    _missing: float = 0.0
    _noise: RangeNoise | None = None

    def take(
        self,
        nis: float | None,
        fit: RangeFit | None,
        strain: float = 0.0,
        corrected_m: float = 0.0,
    ) -> None:
        """Notes one scan's normalised innovation squared and the fit of its ranges.

        strain: of the wheels' learnt constants, in standard deviations of what was thought of them.
        corrected_m: offset by which the ranges had been corrected before.
        """
        self.count += 1
        self._strain = strain
        share = 1.0 / min(self.count, _MEMORY)
        if nis is not None:
            self._nis += share * (min(nis, _MOST_NIS) - self._nis)
        if fit is not None:
            self._scale += share * (fit.scale - self._scale)
            self._missing += share * (fit.missing_ratio - self._missing)
            self._noise = fit.noise
            if math.isfinite(fit.offset_sigma_m) and fit.offset_sigma_m > 0.0:
                information = fit.offset_sigma_m**-2
                self._offset_information += information
                self._offset_pull += information * (fit.offset_m + corrected_m)

    @property
    def offset_m(self) -> float:
        """Mean range offset so far [m]."""
        return self._offset_pull / self._offset_information if self._offset_information else 0.0

    @property
    def has_offset(self) -> bool:
        """Whether the ranges have an offset, beyond doubt and worth a word."""
        sigmas = abs(self._offset_pull) / math.sqrt(self._offset_information or 1.0)
        return sigmas > self.offset_limit_sigmas and abs(self.offset_m) > _LEAST_OFFSET_M

    @property
    def warnings(self) -> tuple[str, ...]:
        """What does not fit, in words; empty where all is as assumed."""
        if self.count == 0:
            return ()
        said = []
        low, high = self.scale_limits
        if self._scale and not low <= self._scale <= high:
            said.append(
                f"ranges scatter {self._scale:.2f} times as wide as the laser model's noise says:"
                f" {_sigma_to_give(self._noise, self._scale)}"
            )
        if self.has_offset:
            said.append(
                f"ranges are {1000.0 * self.offset_m:+.1f} mm off the map on average, the same for"
                " all beams, and are corrected by that: is the laser's zero off, or the map's scale"
                " (resolution)?"
            )
        if self.count >= _LEAST and self._missing > self.missing_limit:
            said.append(
                f"{100.0 * self._missing:.1f} % of the beams go through walls of the map: something"
                " was moved or taken away since it was made, and the pose is less sure than it says"
            )
        if self.count >= _LEAST and self._nis > self.nis_limit:
            said.append(
                f"odometry and scan matches differ: normalised innovation {self._nis:.1f} where 3"
                f" is expected: {_CHECK}"
            )
        if self.count >= _LEAST and self._strain > self.strain_limit:
            said.append(
                f"the wheels would have to be {self._strain:.0f} times as wrong as thought to explain"
                f" the scans: {_CHECK}"
            )
        return tuple(said)


def _sigma_to_give(noise: RangeNoise | None, scale: float) -> str:
    """What to assume of the noise in place of what was, where that is known, in words."""
    if noise is None:
        return "multiply its sigma by that (of a log: --range-sigma)"
    fitting = [
        (at_m, max(scale * sigma_m, _LEAST_SIGMA_M), sigma_m) for at_m, sigma_m in noise.sigma_at_m
    ]
    (near_m, sigma_m, was_m), (far_m, most_m, _) = fitting[0], fitting[-1]
    if len(fitting) > 1:
        return (
            f"give it sigmas from {sigma_m:.2g} m at {near_m:g} m to {most_m:.2g} m at {far_m:g} m"
        )
    return (
        f"give it a sigma of {sigma_m:.2g} m, where it has {was_m:.2g} m (of a log:"
        f" --range-sigma {sigma_m:.2g})"
    )
