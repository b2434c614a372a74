"""rsvideo view: a page on this machine for trying settings and watching jobs."""

import os
import sys
import tempfile
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from rsvideo.cli.exit_codes import RefusedError, refusing
from rsvideo.cli.terminal import say

if TYPE_CHECKING:
    from rsvideo.view.opened import Opened


def view(
    path: Annotated[Path, typer.Argument(metavar="[FOLDER or JOB.yaml]", help="What is shown; the current folder unless given.")] = Path(),
    port: Annotated[int, Option(min=0, max=65535, help="Of this machine; 0 takes a free one.")] = 0,
    browser: Annotated[bool, Option("--browser/--no-browser", help="Open the page, or print its address only.")] = True,
) -> int:
    """Open a page in the browser on which clips are tried, jobs watched and cameras measured; Ctrl-C ends it, and no job.

    Only this machine's browser can reach it, with the token in its address. Nothing outside of FOLDER is shown; of a job, the folders
    of its file, its sources and its results.
    """
    from rsvideo.cli.exit_codes import Code

    with refusing():
        opened = _opened(path)
        try:
            from rsvideo.view import server
        except ImportError as error:
            raise RefusedError("rsvideo view needs FastAPI and uvicorn; pip install 'rsvideo[view]' brings them") from error
    with tempfile.TemporaryDirectory(prefix="rsvideo-") as folder:

        def ready(address: str) -> None:
            say(f"the page is at {address}; Ctrl-C ends it, runs go on")
            sys.stderr.flush()
            if browser:
                _show(address, Path(folder))

        try:
            server.serve(opened, port=port, ready=ready)
        except OSError as error:
            raise RefusedError(
                f"port {port} of this machine cannot be taken: {error.strerror or error}; --port 0 takes a free one"
            ) from error
    return Code.DONE


def _opened(path: Path) -> "Opened":
    """The folders that a folder, or a job's file, opens."""
    from rsvideo.config.files import UnreadableError
    from rsvideo.view.opened import Opened

    if path.is_dir():
        return Opened.of(path)
    if not path.is_file():
        raise UnreadableError(f"{path} does not exist; give a folder with clips, or a job's file")
    from rsvideo.batch import plan

    batch = plan.read(path, overwrite=True)
    sources = [item.request.source.absolute().parent for item in batch.items]
    return Opened.of(path.absolute().parent, *sources, later=(batch.folder.absolute(),), start=path.absolute())


def _show(address: str, folder: Path) -> None:
    """Open the browser by a file that only its owner reads: other users see what a command is called with."""
    import webbrowser

    file = folder / "rsvideo.html"
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as page:
        page.write(f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={escape(address, quote=True)}">')
    webbrowser.open(file.as_uri())
