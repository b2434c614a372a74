"""Turns a function named by its file, `rsvideo/physics/shutter.py:ShutterTiming`, into a link to the code reference.

Names that begin with an underscore stay plain: the reference lists what is public. A name that does not exist fails the build.
"""

import re

HOME = re.compile(r"`((?:rsvideo|calibration)/[\w/]+)\.py:([A-Za-z][\w.]*)`")


def on_page_markdown(markdown: str, **_: object) -> str:
    """MkDocs calls this with the text of each page."""

    def link(home: re.Match[str]) -> str:
        module = home[1].replace("/", ".").removesuffix(".__init__")
        return f"[{home[0]}][{module}.{home[2]}]"

    return HOME.sub(link, markdown)
