"""Where the whole logs lie, for the tests that need them."""

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).parents[3] / "shared" / "data"


def shared_log(name: str) -> Path:
    """The path of a whole log; skips the test where the logs are not beside the repository."""
    path = SHARED_DATA / name
    if not path.exists():
        pytest.skip(f"the whole logs are not part of the repository: {path} is not there")
    return path
