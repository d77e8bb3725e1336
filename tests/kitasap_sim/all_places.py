"""The places that ship, for tests that take seconds in each: all but the first are slow ones."""

import pytest

from kitasap_sim.place_files import place_names

FIRST, *_REST = place_names()
PLACES = [FIRST, *(pytest.param(name, marks=pytest.mark.slow) for name in _REST)]
