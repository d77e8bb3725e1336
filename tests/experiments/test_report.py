"""The report: one page that needs nothing else, and whose numbers are those of the runs."""

import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from itertools import islice
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from experiments import mapping, runs
from experiments.cli import main
from experiments.figures.inline import inline_svg
from experiments.figures.kidnap_map import kidnap_map_drawn
from experiments.kept_maps import keep_maps, kept_maps
from experiments.report import page as report_page
from experiments.report.commands import run_command, trial_command
from experiments.runs import Run
from experiments.trials import TrialConfig
from tests.experiments.refusals import line_of_refusal, refusal

VOID = {"meta", "link", "br", "img", "input", "hr"}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


class Page(HTMLParser):
    """What stands in a page: its tags in order, its words by tag, and the numbers by run."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: dict[str, list[str]] = {}
        self.numbers: list[tuple[str, dict[str, str | None], str]] = []
        self._open: list[str] = []
        self._run = ""
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)
            self.words.setdefault(tag, []).append("")
        self._run = dict(attrs).get("data-run") or self._run

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self._open.pop() == tag, f"</{tag}> closes something else"

    def handle_data(self, data):
        if self._open:
            self.words[self._open[-1]][-1] += data
            if self._open[-1] == "data":
                self.numbers.append((self._run, self.tags[-1][1], data))


@pytest.fixture(scope="module")
def folder(box_room, tmp_path_factory) -> Path:
    """Small runs of the paper's three experiments; the kidnaps anywhere."""
    out = tmp_path_factory.mktemp("runs")
    small = TrialConfig(poses="random", place=box_room, methods=("paper", "fast"))
    kidnaps = replace(small, poses="anywhere")
    drives = replace(mapping.DEFAULTS, place=box_room, methods=("odometry",), people=0)
    results, original, measured = {}, runs.trial_result, mapping.measured

    def kept(experiment, config, seed, index):
        results[index] = original(experiment, config, seed, index)
        return results[index]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runs, "rehearse", lambda *_: None)
        Run("localization", small, 5, 12, out / "localization").execute(1, lambda *_: None)
        Run("kidnap", kidnaps, 5, 2, out / "kidnap").execute(1, lambda *_: None)
        patch.setattr(runs, "trial_result", kept)
        # the first six seconds of a drive: a map is a map
        patch.setattr(mapping, "measured", lambda *drive: islice(measured(*drive), 60))
        Run("mapping", drives, 5, 1, out / "mapping").execute(1, lambda *_: None)
    keep_maps(out / "mapping", results)
    return out


@pytest.fixture(scope="module")
def report(folder, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("report") / "report.html"
    assert main(["report", str(folder), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def page(report) -> Page:
    return Page(report.read_text())


@pytest.fixture
def undrawn(monkeypatch) -> None:
    """Pages without figures: they are most of the time that one takes."""
    monkeypatch.setattr(report_page, "pictures_of", lambda run, key: [])


@pytest.fixture
def copied(folder, tmp_path) -> Path:
    """The localization alone, to be damaged."""
    return Path(shutil.copytree(folder / "localization", tmp_path / "run"))


def summary_of(folder: Path, run: str) -> dict:
    name = ("localization", "kidnap", "mapping")[int(run.removeprefix("run-"))]
    return json.loads((folder / name / "summary.json").read_text())


def test_every_number_of_a_table_is_that_of_the_summary(folder, page):
    assert len(page.numbers) > 120
    for run, attributes, text in page.numbers:
        value = summary_of(folder, run)
        for word in attributes["data-key"].split("."):
            value = value[int(word)] if isinstance(value, list) else value[word]
        assert float(attributes["value"]) == value
        # what is shown is it, to half of its last digit
        digits = len(text.partition(".")[2])
        shown = float(attributes["data-scale"]) * value
        assert abs(float(text) - shown) <= 0.5000001 * 10.0**-digits, (attributes, text)
    keys = {(run, attributes["data-key"]) for run, attributes, _ in page.numbers}
    for key in ("x_cm.mean", "x_cm.max", "x_cm.std", "ci95.x_cm.mean.0", "success_ci95.1"):
        assert ("run-0", f"methods.fast.{key}") in keys
    assert ("run-1", "methods.fast.detected_rate") in keys
    assert ("run-2", "methods.odometry.map_recall") in keys


def test_page_holds_all_that_it_shows(report, page):
    assert report.stat().st_size < 2_000_000
    names = [tag for tag, _ in page.tags]
    assert "script" not in names
    assert "Kitasap: report of localization, kidnap, mapping" in page.words["title"]
    for tag, attributes in page.tags:
        for name in ("src", "href", "xlink:href", "action", "data", "srcset", "poster"):
            assert re.match(r"#|data:", attributes.get(name) or "#"), (tag, attributes)
        assert not any(name.startswith("on") for name in attributes)
        if tag == "meta" and attributes.get("http-equiv"):
            assert attributes["content"].startswith("default-src 'none'")
    assert "@import" not in report.read_text()
    assert not re.search(r"url\((?!#)", report.read_text())
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    asked = {
        attributes["aria-labelledby"]
        for _, attributes in page.tags
        if "aria-labelledby" in attributes
    }
    assert asked <= set(ids)


def test_figures_are_there_named_and_explained(page):
    drawings = [attributes for tag, attributes in page.tags if tag == "svg"]
    titles = " ".join(page.words["h3"])
    for words in (
        *("Fig. 5", "Fig. 6", "Fig. 7: trial 0", "Convergence of expression (1)"),
        *("Cramér-Rao", "kidnapped robot finds itself", "ROC", "How good the maps are"),
    ):
        assert words in titles
    assert len(drawings) == len(page.words["figure"]) == len(page.words["figcaption"]) == 10
    assert all(one["role"] == "img" and one["viewbox"] for one in drawings)
    assert all(len(words) > 20 for words in page.words["figcaption"])


def test_worst_trials_are_repeated_by_their_commands(folder, tmp_path, page, monkeypatch, capsys):
    monkeypatch.setattr("experiments.figures.trial_picture", lambda *_: "none")
    commands = [words for words in page.words["code"] if words.startswith("kitasap trial ")]
    one_of_each = {shlex.split(words)[2]: words for words in commands}
    assert set(one_of_each) == {"localization", "kidnap", "mapping"}
    del one_of_each["mapping"]  # a drive of two minutes; its options are those of the others
    for experiment, words in one_of_each.items():
        arguments = shlex.split(words)[1:]
        assert main([*arguments, "--out", str(tmp_path)]) == 0
        lines = (folder / experiment / "trials.jsonl").read_text().splitlines()
        index = int(arguments[arguments.index("--index") + 1])
        assert capsys.readouterr().out == lines[index] + "\n"


def test_commands_say_all_that_differs_and_nothing_else():
    config = TrialConfig(poses="random", place="my room's.xml", people=2, methods=("fast", "limit"))
    assert trial_command("kidnap", config, 3, 7) == (
        "kitasap trial kidnap --seed 3 --index 7 --poses random --place 'my room'\"'\"'s.xml'"
        " --method fast,limit --people 2"
    )
    assert (
        trial_command("mapping", mapping.DEFAULTS, 0, 1)
        == "kitasap trial mapping --seed 0 --index 1"
    )
    assert run_command("kidnap", TrialConfig(), 1, 5, Path("a b")) == (
        "kitasap run kidnap --trials 5 --seed 1 --out 'a b'"
    )
    # no option says this one
    assert trial_command("kidnap", replace(TrialConfig(), start_error_m=0.2), 0, 0) is None


def browsed(tmp_path: Path, page: Path) -> tuple[dict, list[str]]:
    """What a real browser says of a page on a screen of 390 pixels, and what its console shows."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("no Chromium or Chrome on this machine: the page was parsed, and not opened")
    frame = tmp_path / "frame.html"
    frame.write_text(
        f"""<iframe id="page" src="{page.as_uri()}" width="390" height="800"></iframe><script>
        onload = () => {{
          const inner = document.getElementById("page").contentDocument;
          const drawn = [...inner.querySelectorAll("svg")].map(one => one.getBoundingClientRect());
          document.title = JSON.stringify({{
            title: inner.title, width: inner.scrollingElement.scrollWidth,
            drawn: drawn.filter(box => box.width > 100 && box.height > 50).length,
          }});
        }};</script>"""
    )
    done = subprocess.run(
        [
            *(browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic"),
            *("--no-first-run", "--disable-background-networking", "--disable-component-update"),
            *("--disable-sync", "--allow-file-access-from-files", "--enable-logging=stderr"),
            *(f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", frame.as_uri()),
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    told = re.search(r"<title>(.*?)</title>", done.stdout)
    assert told is not None, done.stdout[:500]
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return json.loads(told[1].replace("&quot;", '"')), console


def test_real_browser_opens_it_without_an_error(report, tmp_path):
    told, console = browsed(tmp_path, report)
    assert told["title"] == "Kitasap: report of localization, kidnap, mapping"
    assert told["drawn"] == 10
    # nothing but tables and figures scrolls sideways on a phone
    assert told["width"] <= 390
    assert console == []
    # and a page with an error would have been noticed
    (tmp_path / "wrong.html").write_text(
        "<title>x</title><img src='http://[/'><script>nothing()</script>"
    )
    _, console = browsed(tmp_path, tmp_path / "wrong.html")
    assert console != []


@pytest.mark.usefixtures("undrawn")
def test_what_is_missing_is_named_with_the_command_that_makes_it(folder, capsys):
    assert main(["report", str(folder / "localization")]) == 0
    out = folder / "localization/report.html"
    printed = capsys.readouterr()
    assert printed.out == f"report: {out}\n"
    for name in ("kidnap", "mapping"):
        assert f"not in the report: {name}: no run of it in the folders named" in printed.err
        command = f"kitasap run {name} --trials 100 --seed 5 --out {folder}"
        assert f"what makes it: {command}" in printed.err
        assert command in Page(out.read_text()).words["code"]
    # an earlier report is written anew; whatever else is there is not
    before = out.read_bytes()
    assert main(["report", str(folder / "localization")]) == 0
    assert out.read_bytes() == before
    out.write_text("<html>my own</html>")
    capsys.readouterr()
    assert refusal(capsys, "report", folder / "localization") == (
        f"{out} is there, and is no report of kitasap: name another file by --out"
    )
    assert out.read_text() == "<html>my own</html>"
    out.unlink()


@pytest.mark.usefixtures("undrawn")
def test_unfinished_run_is_said_and_the_others_are_reported(folder, tmp_path, capsys):
    shutil.copytree(folder / "localization", tmp_path / "localization")
    shutil.copytree(folder / "kidnap", tmp_path / "kidnap")
    (tmp_path / "kidnap/summary.json").unlink()
    assert main(["report", str(tmp_path)]) == 0
    assert "kidnap: 2 of 2 trials" in capsys.readouterr().err
    line = refusal(capsys, "report", tmp_path / "kidnap")
    assert line.startswith(
        f"no run in {tmp_path}/kidnap is finished; what goes on with it: kitasap "
    )


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_names_are_words_and_neither_markup_nor_formulas(box_room, tmp_path):
    place = tmp_path / "a<b onload=x>&\"'$y{ $frac{ü.xml"
    shutil.copy(box_room, place)
    config = TrialConfig(poses="random", place=str(place), methods=("odometry",))
    Run("kidnap", replace(config, poses="anywhere"), 0, 1, tmp_path / "run").execute(
        1, lambda *_: None
    )
    assert main(["report", str(tmp_path / "run")]) == 0
    text = (tmp_path / "run/report.html").read_text()
    assert "<b onload" not in text
    figure = kidnap_map_drawn(tmp_path / "run")
    svg = inline_svg(figure, "key", "a < b")
    assert "Kidnapped in a&lt;b onload=x&gt;&amp;\"'$y{ $frac{ü: does" in svg
    assert '<title id="key-title">a &lt; b</title>' in svg
    assert any(str(place) in shlex.split(words) for words in Page(text).words["code"] if words)


def test_a_narrow_figure_does_not_fill_the_page_with_its_words():
    figure, _ = plt.subplots(figsize=(2.0, 1.0))
    assert 'style="--wide: 259px"' in inline_svg(figure, "key", "small")  # 144 points


def damaged_config(folder: Path, **changes: object) -> None:
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps(config | changes))


def damages() -> Iterator:
    def texts(name, text):
        return lambda folder: (folder / name).write_bytes(text)

    def without(key):
        return lambda folder: damaged_config(folder, **{key: None})

    def summary(change):
        def damage(folder):
            path = folder / "summary.json"
            content = json.loads(path.read_text())
            change(content)
            path.write_text(json.dumps(content))

        return damage

    yield texts("config.json", b"\xff\xfe"), "config.json is not JSON: "
    yield texts("config.json", b"[]"), "config.json is not of a run: it holds a list"
    yield texts("config.json", b"{}"), "config.json is not of a run: 'config' is missing"
    yield (
        texts(
            "config.json", b'{"config": {"place": "<script>"}, "trials": 1, "experiment": "kidnap"}'
        ),
        ("config.json is of another version, or of no run: it differs in "),
    )
    yield (
        (lambda f: damaged_config(f, experiment="flying")),
        "config.json: no experiment called 'fly",
    )
    yield without("seed"), "config.json is not of a run: 'seed' is missing"
    yield texts("summary.json", b'{"methods": '), "summary.json is not JSON: "
    yield texts("summary.json", b"{}"), "summary.json is not of a run: 'wall_s' is missing"
    yield (
        summary(lambda s: s["methods"]["paper"].update(failures=-1)),
        (
            "summary.json tells of other trials than trials.jsonl holds: the same `kitasap run` again"
        ),
    )
    yield (
        summary(lambda s: s["methods"]["paper"].update(rmse_mm="<b>")),
        (" is damaged, or of another version: methods.paper.rmse_mm is no number: '<b>'"),
    )
    yield (
        summary(lambda s: s["methods"]["paper"].update(x_cm=3)),
        " is damaged, or of another version",
    )
    yield summary(lambda s: s["methods"].pop("paper")), "summary.json tells of other trials"
    yield texts("trials.jsonl", b"nonsense\n"), "trials.jsonl line 1 is not a trial of this run: "
    yield (
        texts("trials.jsonl", b'{"index": 0, "status": "ok"}\n'),
        "trials.jsonl line 1 is not a trial",
    )
    yield texts("trials.csv", b"nonsense\n"), "trials.csv tells of other trials than trials.jsonl"


@pytest.mark.parametrize(("damage", "said"), list(damages()))
def test_damaged_run_is_refused_in_one_line(copied, capsys, damage, said):
    damage(copied)
    line = refusal(capsys, "report", copied)
    assert line.startswith(str(copied))
    assert line.removeprefix(str(copied)).removeprefix("/").startswith(said)
    assert not (copied / "report.html").exists()


def test_what_is_no_run_is_refused(tmp_path, capsys, folder):
    assert refusal(capsys, "report", tmp_path / "none").startswith(f"{tmp_path}/none is no folder")
    assert refusal(capsys, "report", tmp_path).startswith(f"{tmp_path} holds no run: looked for ")
    assert refusal(capsys, "report") == "Missing argument 'DIR...'."
    run = folder / "localization"
    line = refusal(capsys, "report", run, "--out", tmp_path)
    assert line == f"a file is to be written, and {tmp_path} is a folder"
    (tmp_path / "file").touch()
    assert "Not a directory" in refusal(capsys, "report", run, "--out", tmp_path / "file/x.html")


def test_maps_are_kept_as_they_were_and_damaged_ones_refused(folder, tmp_path, capsys):
    (kept,) = kept_maps(folder / "mapping", ("odometry",))
    record = json.loads((folder / "mapping/trials.jsonl").read_text())["methods"]["odometry"]
    one = kept.maps["odometry"]
    assert len(one.points_m) == record["map_points"]
    assert (one.off_m <= 0.05).mean() == pytest.approx(record["map_precision"], abs=1e-3)
    assert (len(one.missed_m) > 0) == (record["map_recall"] < 1.0)
    run = Path(shutil.copytree(folder / "mapping", tmp_path / "run"))
    whole = (run / "maps.npz").read_bytes()
    for content in (b"", b"PK", whole[:1000]):
        (run / "maps.npz").write_bytes(content)
        line = refusal(capsys, "report", run)
        assert f"{run}/maps.npz does not hold the maps of this run" in line
    (run / "maps.npz").unlink()
    assert main(["report", str(run)]) == 0
    (said,) = (
        words for words in Page((run / "report.html").read_text()).words["div"] if "maps" in words
    )
    assert "this run kept no maps" in said


def test_reproduce_runs_what_the_paper_did_and_reports(
    folder, tmp_path, monkeypatch, capsys, undrawn
):
    asked = []

    def done(all_runs, jobs):
        asked.extend(all_runs)
        for run in all_runs:
            shutil.copytree(folder / run.experiment, run.folder, dirs_exist_ok=True)
        return False

    monkeypatch.setattr("experiments.commands.execution.has_raised", done)
    out = tmp_path / "paper"
    assert main(["reproduce", "--out", str(out), "--trials", "7", "--jobs", "1"]) == 0
    assert [(run.experiment, run.trials, run.config.poses) for run in asked] == [
        ("localization", 7, "paper"),
        ("kidnap", 7, "paper"),
        ("mapping", 7, "paper"),
    ]
    assert capsys.readouterr().out == f"report: {out}/report.html\n"
    # the same once more: what lies there is of another configuration, and is not touched
    line = line_of_refusal(capsys, main(["reproduce", "--out", str(out)]))
    assert "holds trials of another configuration" in line


@pytest.mark.slow
def test_paper_is_reproduced_by_one_command(tmp_path, capsys):
    # a trial of each experiment, as the paper had them, and each by its own command again
    assert main(["reproduce", "--trials", "1", "--jobs", "1", "--out", str(tmp_path)]) == 0
    page = Page((tmp_path / "report.html").read_text())
    commands = [words for words in page.words["code"] if words.startswith("kitasap trial ")]
    assert len(commands) == 3
    for words in commands:
        capsys.readouterr()
        experiment = shlex.split(words)[2]
        assert main([*shlex.split(words)[1:], "--out", str(tmp_path / "again")]) == 0
        line = (tmp_path / experiment / "trials.jsonl").read_text()
        assert capsys.readouterr().out == line
    assert sum("Fig. 7" in words for words in page.words["h3"]) == 1
