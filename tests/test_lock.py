"""The lock file: of every dependency one version, which pyproject.toml allows."""

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

REPOSITORY = Path(__file__).parents[1]


def locked() -> dict[str, set[str]]:
    """Versions by name; several where they differ from platform to platform."""
    found: dict[str, set[str]] = {}
    for line in (REPOSITORY / ".ci/requirements.lock").read_text().splitlines():
        if line and not line.startswith("#"):
            pinned = Requirement(line)
            (version,) = pinned.specifier
            assert version.operator == "=="
            found.setdefault(canonicalize_name(pinned.name), set()).add(version.version)
    return found


def required() -> list[Requirement]:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    return [
        Requirement(text)
        for text in (*project["dependencies"], *project["optional-dependencies"]["dev"])
    ]


@pytest.mark.parametrize("requirement", required(), ids=str)
def test_what_is_required_is_locked_at_a_version_that_is_allowed(requirement):
    versions = locked()[canonicalize_name(requirement.name)]
    assert all(requirement.specifier.contains(version) for version in versions)


def test_lock_names_no_registry():
    text = (REPOSITORY / ".ci/requirements.lock").read_text()
    assert "://" not in text
    assert "--" not in text
