"""What the tests share."""

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture
def shared_data() -> Path:
    """The folder of the whole real logs, which lies beside the project and not in it."""
    if not SHARED_DATA.is_dir():
        pytest.skip("needs the real logs of ../shared/data, which are not part of the project")
    return SHARED_DATA
