"""What is wrong with the odometry of a log, from one record to the next, and how far it is to be believed."""

from __future__ import annotations

from slam.arrays import FloatArray
from slam.measurements import LaserScan
from slam.readers.record_dropouts import RecordDropouts
from slam.readers.record_gaps import RecordGaps
from slam.readers.record_jumps import RecordJumps
from slam.se2 import SE2


class RecordFaults:
    """Told of all records of a log, and the motions between them."""

    def __init__(self) -> None:
        self._gaps, self._jumps, self._dropouts = RecordGaps(), RecordJumps(), RecordDropouts()

    def believed(
        self, time_s: float, told: SE2, is_denied: bool = False
    ) -> tuple[SE2, FloatArray | None]:
        """A motion since the record before as far as it is believed, itself if it is; and what is to be added
        to its (3, 3) covariance, in the robot's frame at its end, if anything is. is_denied: scans deny that
        the robot stands."""
        motion, jump = self._jumps.believed(time_s, told)
        gap = self._gaps.covariance(time_s, motion)
        self._dropouts.take(time_s, motion, is_denied)
        if jump is None or gap is None:
            return motion, gap if jump is None else jump
        return motion, jump + gap

    def since_scan(self, scan: LaserScan) -> FloatArray | None:
        """See `RecordDropouts.covariance`."""
        return self._dropouts.covariance(scan)
