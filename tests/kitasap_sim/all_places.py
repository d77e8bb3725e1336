"""The places that ship, for tests that take seconds in each: all but the smallest are slow ones."""

import pytest

from kitasap_sim.place_files import place_names

PLACES = [
    pytest.param(name, marks=[] if name == "symmetric_room" else pytest.mark.slow)
    for name in place_names()
]
