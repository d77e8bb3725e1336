"""`kitasap doctor` tells what is broken, names what mends it, and is not broken by it."""

import sys

import pytest

from experiments import doctor
from experiments.cli import main
from experiments.doctor import Check, _Requirement
from kitasap_sim.rendering import RenderingError, check_rendering


@pytest.fixture
def quick(monkeypatch) -> None:
    """Nothing is tried: that takes a second of each core."""
    monkeypatch.setattr(doctor, "_in_process", lambda code, as_asked=False: (0, "tried"))


@pytest.fixture
def requirements(monkeypatch):
    """Sets what is asked for, in place of pyproject.toml."""

    def ask(*lines: tuple[str, str | None]):
        asked = [_Requirement(line.partition(">")[0], line, extra) for line, extra in lines]
        monkeypatch.setattr(doctor, "_requirements", lambda: iter(asked))

    return ask


@pytest.mark.usefixtures("quick")
def test_sound_installation_is_called_so(requirements, capsys):
    requirements(("numpy>=2", None), ("nothing-of-the-kind", "far"))
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == "the core works"
    assert any(line.split()[:2] == ["ok", "numpy"] for line in lines)
    # an extra that is not there is no fault, and the line that brings it stands below
    at = next(k for k, line in enumerate(lines) if line.split()[:2] == ["missing", "far"])
    assert "lacks nothing-of-the-kind" in lines[at]
    assert lines[at + 1].strip().startswith("mend it with: pip install ")
    assert lines[at + 1].endswith("[far]'")


@pytest.mark.usefixtures("quick")
def test_missing_library_of_the_core_is_status_1(requirements, capsys):
    requirements(("nothing-of-the-kind>=2.1", None), ("numpy>=99", None))
    assert main(["doctor"]) == 1
    said = capsys.readouterr().out
    assert "missing nothing-of-the-kind" in said
    assert "mend it with: pip install 'nothing-of-the-kind>=2.1'" in said
    assert "is not numpy>=99" in said
    assert said.splitlines()[-1] == "the core does not work: 2 to mend, see above"


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("import os; os.abort()", "ended by signal 6"),
        ("raise SystemExit(3)", ""),
        ("raise ImportError('libfoo.so.1: cannot open shared object')", "libfoo.so.1: cannot open"),
        ("def", "SyntaxError"),
    ],
)
def test_library_that_is_broken_does_not_break_the_doctor(tmp_path, monkeypatch, source, said):
    (tmp_path / "jinja2.py").write_text(source)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    check = doctor._library(_Requirement("jinja2", "jinja2>=3.1", None))
    assert (check.state, check.is_well) == (doctor.BROKEN, False)
    assert said in check.found
    assert check.mend == "pip install 'jinja2>=3.1' --force-reinstall"


def test_system_library_is_mended_by_what_the_message_names(monkeypatch):
    message = "ImportError: Open3D needs libGL.so: sudo apt-get install libgl1 (libGL.so.1: cannot)"
    monkeypatch.setattr(doctor, "_in_process", lambda code: (1, message))
    assert doctor._tried("ICP", "", "else").mend == "sudo apt-get install libgl1"
    message = "ImportError: Open3D needs libusb-1.0: pip install libusb-package, or sudo apt-get"
    monkeypatch.setattr(doctor, "_in_process", lambda code: (1, message))
    assert doctor._tried("ICP", "", "else").mend == "pip install libusb-package"
    assert doctor._compiled_code().is_well


def test_without_opengl_only_pictures_are_missing(monkeypatch):
    said = "kitasap_sim.rendering.RenderingError: no OpenGL to draw with (libEGL.so.1: cannot)"
    monkeypatch.setattr(doctor, "_in_process", lambda code, as_asked: (1, said))
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    check = doctor._rendering()
    assert check.is_well
    assert check.found == "no OpenGL to draw with (libEGL.so.1: cannot)"
    assert "libegl1" in check.mend or "MUJOCO_GL=egl" in check.mend


@pytest.mark.slow
def test_opengl_with_which_mujoco_cannot_be_loaded_is_one_fault_with_its_own_mend(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    check = doctor._rendering()
    assert (check.state, check.is_well, check.mend) == (doctor.BROKEN, False, "unset MUJOCO_GL")
    assert "MUJOCO_GL=nonsense" in check.found
    # which is no fault of the library's
    assert doctor._library(_Requirement("mujoco", "mujoco>=3", None)).state == doctor.OK


def test_what_stands_on_a_broken_library_is_not_told_to_be_mended(requirements, monkeypatch):
    requirements(("numba>=99", None))
    monkeypatch.setattr(doctor, "_in_process", lambda code, as_asked=False: (1, "no numba"))
    checks = {check.name: check for check in doctor.examined()}
    assert checks["numba"].mend.startswith("pip install 'numba>=99'")
    tried = ("Open3D's ICP", "robot and laser", "OpenGL", "compiled code")
    assert {checks[name].mend for name in tried} == {"the lines above, first"}


def test_requirements_are_those_of_the_project():
    found = {(one.name, one.extra) for one in doctor._requirements()}
    assert {
        ("numpy", None),
        ("jinja2", None),
        ("imageio-ffmpeg", "video"),
        ("ruff", "dev"),
    } <= found
    # one of the two wheels of Open3D, by its marker
    assert len({("open3d", None), ("open3d-cpu", None)} & found) == 1
    assert doctor._of_extra("evo>=1.30 ; extra == 'dev'") == ("evo>=1.30", "dev")
    line = "kiss-icp>=1.2; python_version < '3.14' and extra == 'peers'"
    assert doctor._of_extra(line) == ("kiss-icp>=1.2; python_version < '3.14'", "peers")
    assert doctor._of_extra("numpy>=2.0") == ("numpy>=2.0", None)


def test_project_that_is_installed_nowhere_is_told_of(monkeypatch, tmp_path):
    monkeypatch.setattr(doctor, "_PROJECT", tmp_path)
    monkeypatch.setattr(doctor, "requires", lambda name: None)
    assert list(doctor._requirements()) == []
    assert doctor._version("nothing-of-the-kind") is None


def test_text_is_in_columns_and_parts():
    checks = [
        Check("core", "a", doctor.OK, "1.0", "never shown", True),
        Check("core", "b", doctor.BROKEN, "2.0: bad", "mend b", True),
        Check("extras", "c", doctor.MISSING, "lacks d", "mend c"),
    ]
    assert doctor.told(checks).splitlines() == [
        "core",
        "  ok      a                  1.0",
        "  BROKEN  b                  2.0: bad",
        "          mend it with: mend b",
        "extras",
        "  missing c                  lacks d",
        "          mend it with: mend c",
        "the core does not work: 1 to mend, see above",
    ]


@pytest.mark.slow
def test_pictures_are_well_where_something_draws_them():
    try:
        drawn_by = check_rendering()
    except RenderingError:
        pytest.skip("no OpenGL here")
    assert doctor._rendering() == Check("pictures", "OpenGL", doctor.OK, drawn_by)


@pytest.mark.slow
def test_this_machine_is_well(capsys):
    assert main(["doctor"]) == 0, capsys.readouterr().out
    said = capsys.readouterr().out
    assert "it fits a pose" in said
    assert "a scan of 682 beams" in said
    assert f"Python {sys.version.split()[0]}" in said
