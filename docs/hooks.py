"""What MkDocs does to the pages besides building them.

A function named by its file, `rsvideo/physics/shutter.py:ShutterTiming`, becomes a link to the code reference, unless its name
begins with an underscore: the reference lists what is public. A name that does not exist fails the build. Pictures are taken from
samples/, where pages find them also when they are read as files. Docstrings are plain text: what looks like HTML in them is none.
"""

import re
from pathlib import Path
from typing import Any

from griffe import Extension, Object
from mkdocs.structure.files import File, Files

HOME = re.compile(r"`((?:rsvideo|calibration)/[\w/]+)\.py:([A-Za-z][\w.]*)`")
PICTURES = "samples/clip"


def on_files(files: Files, config: Any) -> Files:
    """Add the samples' pictures to the site."""
    for picture in sorted((Path(config.config_file_path).parent / PICTURES).glob("*.jpg")):
        files.append(File(picture.name, str(picture.parent), config.site_dir, use_directory_urls=False))
    return files


def on_page_markdown(markdown: str, **_: object) -> str:
    """Turn a page's names into links."""

    def link(home: re.Match[str]) -> str:
        module = home[1].replace("/", ".").removesuffix(".__init__")
        return f"[{home[0]}][{module}.{home[2]}]"

    return HOME.sub(link, markdown).replace(f"](../{PICTURES}/", "](")


class PlainDocstrings(Extension):
    """Keeps `<dK m, r>` and `<stem>` in docstrings from being taken for HTML; blocks of code are kept as they are anyway."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Griffe calls this with each module, class and function."""
        if obj.docstring:
            lines = obj.docstring.value.splitlines()
            obj.docstring.value = "\n".join(x if x.startswith("    ") else re.sub(r"<(?=\w)", "&lt;", x) for x in lines)
