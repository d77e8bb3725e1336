"""A figure as SVG that stands within a page: small, its names its own, told to who cannot see it."""

import base64
import io
import re
from html import escape

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

_MOST_MARKS = 400
"""Chosen: what has more points or lines is drawn as pixels, between words that stay words."""
_DPI = 130
_MOST_SCALE = 1.8
"""Chosen: pixels of the page for each point of the figure. More make the words of a narrow one giant."""
_COLOURS = 64
"""Chosen: of the pixels; all 16 million would make them three times as large."""


def inline_svg(figure: Figure, key: str, alt: str) -> str:
    """The figure as one `svg` element, and closes it. The same figure and key give the same text.

    key: of letters, digits and hyphens, another for each figure of a page: it goes before all ids.
    alt: what is to be seen, in words.

    The element's property --wide is how wide a page may show it, in pixels.
    """
    for axis in figure.axes:
        for artist in axis.get_children():
            if _count(artist) > _MOST_MARKS:
                artist.set_rasterized(True)
    text = _svg(figure, key)
    plt.close(figure)
    body = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    body = body[body.index("<svg") :]
    # two figures of one page may have clips and markers of one name
    body = re.sub(r'\bid="', f'id="{key}-', body)
    body = re.sub(r'(href="#|url\(#)', rf"\g<1>{key}-", body)
    # each word names eleven fonts; the page does that once
    body = re.sub(r"font-family: 'DejaVu Sans Mono'[^;\"]*", "font-family: monospace", body)
    body = re.sub(r"; font-family: 'DejaVu Sans'[^;\"]*", "", body)
    view = re.search(r'viewBox="0 0 ([\d.]+) [\d.]+"', body)
    assert view is not None
    wide_px = round(_MOST_SCALE * float(view[1]))
    opening = (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
        f' {view[0]} style="--wide: {wide_px}px" role="img" aria-labelledby="{key}-title">'
        f'<title id="{key}-title">{escape(alt)}</title>'
    )
    return opening + re.sub(r"\n\s*", "\n", body[body.index(">") + 1 :]).strip()


def _count(artist: Artist) -> int:
    """How many points or lines it draws."""
    if isinstance(artist, Line2D):
        has_marks = artist.get_marker() not in (None, "None", "", " ")
        return len(np.asarray(artist.get_xydata())) if has_marks else 0
    if isinstance(artist, Collection):
        offsets = np.asarray(artist.get_offsets())
        return max(len(artist.get_paths()), offsets.size // 2)
    return 0


def _svg(figure: Figure, key: str) -> str:
    file = io.StringIO()
    # words as words: smaller, found by a search, and read out
    with plt.rc_context({"svg.hashsalt": key, "svg.fonttype": "none"}):
        figure.savefig(file, format="svg", dpi=_DPI, metadata={"Date": None, "Creator": None})
    return re.sub(r"(?<=base64,)[^\"]+", _with_fewer_colours, file.getvalue())


def _with_fewer_colours(png: re.Match[str]) -> str:
    """The same picture, PNG in base64."""
    pixels = Image.open(io.BytesIO(base64.b64decode(png[0])))
    small = io.BytesIO()
    fewer = pixels.convert("RGBA").quantize(_COLOURS, Image.Quantize.FASTOCTREE)
    fewer.save(small, format="png", optimize=True)
    return base64.b64encode(small.getvalue()).decode()
