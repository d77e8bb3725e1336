"""The documentation of `slam` and `kitasap_sim` as HTML, from their docstrings, by pdoc.

`python -m experiments.api_pages [FOLDER]`; the pages of the two packages are where to begin.
"""

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("slam", "slam.metrics", "slam.pose_graph", "kitasap_sim", "kitasap_sim.env")
_LEFT_OUT = (
    "!slam.warm_up",  # of the same name as the function within, which is shown
    # of the tasks: what they are made of
    r"!kitasap_sim\.env\.(bumper|checks|distance|kernels|keywords|motors|path|picture)",
)
_FOLDER = Path("results") / "api"


def write_pages(folder: Path) -> Path:
    """The first page of the documentation, written into a folder, over what is there.

    Raises ImportError without pdoc, ValueError for a file in place of the folder.
    """
    if find_spec("pdoc") is None:
        raise ImportError("the pages are made by pdoc: pip install 'kitasap[dev]'")
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"the pages go into a folder, and {folder} is a file")
    import pdoc.render

    import kitasap_sim

    # pdoc sees only what was imported, and these names are when they are first asked for
    for name in kitasap_sim.__all__:
        getattr(kitasap_sim, name)
    pdoc.render.configure(docformat="markdown", show_source=False)
    pdoc.pdoc(*PACKAGES, *_LEFT_OUT, output_directory=folder)
    return folder / "index.html"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="python -m experiments.api_pages",
        description="Writes the documentation of slam and kitasap_sim as HTML.",
    )
    parser.add_argument("folder", nargs="?", type=Path, default=_FOLDER, help="where to")
    try:
        print(write_pages(parser.parse_args().folder))
    except (ImportError, ValueError, OSError) as refused:
        print(f"api_pages: {refused}", file=sys.stderr)
        sys.exit(2)
