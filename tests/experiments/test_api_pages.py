"""The documentation made of the docstrings: whole, without a warning, and with its links alive."""

import re
import subprocess
import sys

import pytest

from experiments.api_pages import PACKAGES, write_pages

FIRST = {
    "slam": {"Localizer", "Mapper", "read_log", "LimitMatcher", "KnownMap", "read_map", "Matcher"},
    "kitasap_sim": {"Simulation", "Place", "kidnap", "Pilot", "LASERS"},
}


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, str]:
    """By a package's name. Warnings are errors, as everywhere in the tests."""
    folder = tmp_path_factory.mktemp("api")
    write_pages(folder)
    return {
        ".".join(path.relative_to(folder).with_suffix("").parts): path.read_text(encoding="utf-8")
        for path in folder.rglob("*.html")
    }


def shown(page: str) -> set[str]:
    return set(re.findall(r' id="([\w.]+)"', page))


def test_there_is_a_page_for_each_package_and_task_and_none_for_what_is_within(pages):
    tasks = {"base", "explore", "goto", "relocalize", "track", "variation", "vector"}
    expected = {"index", *PACKAGES, *(f"kitasap_sim.env.{name}" for name in tasks)}
    assert set(pages) == expected


@pytest.mark.parametrize("package", FIRST)
def test_the_docstring_of_a_package_leads_to_where_to_begin(pages, package):
    introduction = pages[package].split('<section id="', 2)[0]
    links = set(re.findall(r'href="#([\w.]+)"', introduction))
    assert links >= FIRST[package]


def test_no_link_within_a_page_is_dead(pages):
    for name, page in pages.items():
        links = set(re.findall(r'href="#([\w.]+)"', page))
        assert links - shown(page) == set(), name


def test_nothing_private_is_shown(pages):
    for name, page in pages.items():
        private = {one for one in shown(page) if re.search(r"(^|\.)_[a-z]", one)}
        assert {one for one in private if not one.endswith("__init__")} == set(), name


def test_without_pdoc_it_is_said_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pdoc", None)
    with pytest.raises(ImportError, match=r"pip install 'kitasap\[dev\]'"):
        write_pages(tmp_path)


def test_a_file_in_place_of_the_folder_is_refused_in_one_line(tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("kept")
    command = [sys.executable, "-m", "experiments.api_pages", str(taken)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        f"api_pages: the pages go into a folder, and {taken} is a file"
    ]
