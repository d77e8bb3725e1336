"""How wide the covariances of matches and motions truly are, beside what they tell."""

from __future__ import annotations

_MOST_NIS = 4.0
"""Chosen: of a normalised innovation squared, per number, no more is learnt from."""
_LEAST, _BY_CHANCE = 0.5, 1.15
"""Chosen: a scale learnt below the second, two of its standard deviations, is chance; to follow it
upwards alone would widen what needs no widening."""


class InnovationScales:
    """Times by which the covariances of matches and of motions are to be widened (Mehra, 1972).

    Innovations tell: each of the two learns as far as an innovation was expected to be its own.
    match, motion: at least 1, since small innovations may be the other's doing just as well.
    """

    def __init__(self, most: float) -> None:
        """most: no scale is larger."""
        self.match = self.motion = 1.0
        self._most, self._count = most, 0
        self._learnt_match = self._learnt_motion = 1.0

    def learn(self, nis: float, share_of_match: float) -> None:
        """From an innovation: nis, normalised by the covariances widened, 1 on average.

        share_of_match: of the innovation's covariance, that is the match's.
        """
        self._count += 1
        share_of_motion = 1.0 - share_of_match
        # by what was learnt, which is followed upwards alone
        expected = (
            share_of_match * self._learnt_match / self.match
            + share_of_motion * self._learnt_motion / self.motion
        )
        excess = (min(nis / expected, _MOST_NIS) - 1.0) / min(self._count + 20.0, 100.0)
        self._learnt_match = self._within(self._learnt_match * (1.0 + share_of_match * excess))
        self._learnt_motion = self._within(self._learnt_motion * (1.0 + share_of_motion * excess))
        self.match = self._learnt_match if self._learnt_match > _BY_CHANCE else 1.0
        self.motion = self._learnt_motion if self._learnt_motion > _BY_CHANCE else 1.0

    def _within(self, scale: float) -> float:
        return min(max(scale, _LEAST), self._most)
