"""A camera measured from a page: views that were dropped in, the commands that measure, their pictures, and the profile that is saved.

Everything happens in a folder of this page's own, and in processes of their own: `rsvideo calibrate` does the work.
"""

import json
import re
import secrets
import shutil
import tempfile
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsvideo.config.files import made_within
from rsvideo.config.media import CLIP_SUFFIXES
from rsvideo.config.placing import aside, check_free, place
from rsvideo.view.errands import Errand, Errands
from rsvideo.view.opened import PHOTOGRAPHS, is_plain

MOST_SESSIONS = 4
MOST_FILES = 120  # of a session
MOST_BYTES = 300_000_000  # of a file
MOST_IN_ALL = 2_000_000_000  # bytes of a session
SECONDS = 1200.0  # that a measurement may take
_DRAWN = 60.0  # seconds that drawing may take
_BOARD = re.compile(r"[A-Za-z0-9_.:]{1,80}")
_HERTZ = re.compile(r"[0-9.]{1,10} ?k?Hz", re.IGNORECASE)
_PAPERS = ("A4", "A3", "A2", "A1", "A0", "letter")
_FORMS = {"svg": "image/svg+xml", "pdf": "application/pdf", "png": "image/png"}


class TooMuchError(ValueError):
    """More was dropped in than there is room for."""


@dataclass(kw_only=True, eq=False)
class Session:
    """One camera that is measured."""

    id: str
    folder: Path
    errands: dict[str, Errand] = field(default_factory=dict)

    @property
    def views(self) -> Path:
        """Where views lie."""
        return self.folder / "views"

    @property
    def profile(self) -> Path:
        """What was measured so far."""
        return self.folder / "profile.yaml"

    def listed(self) -> list[dict[str, Any]]:
        """The views, by name."""
        return [{"name": path.name, "bytes": path.stat().st_size} for path in sorted(self.views.iterdir()) if not path.name.startswith(".")]


class Bench:
    """Holds what is measured at present; forgotten with the server."""

    def __init__(self, errands: Errands) -> None:
        self._errands = errands
        self._folder = Path(tempfile.mkdtemp(prefix="rsvideo-view-"))
        self._sessions: dict[str, Session] = {}
        self._boards: dict[tuple[str, str, str], bytes] = {}

    def board(self, name: str, paper: str, form: str) -> tuple[str, bytes]:
        """A board as a file; ValueError where it cannot be drawn."""
        if not _BOARD.fullmatch(name):
            raise ValueError("a board is written like chessboard:9x6:25mm, charuco:5x7:DICT_6X6_250:30mm:22mm or aprilgrid:6x6:30mm:9mm")
        if paper not in _PAPERS or form not in _FORMS:
            raise ValueError(f"a sheet is one of {', '.join(_PAPERS)}, and a form one of {', '.join(_FORMS)}")
        key = name, paper, form
        if key not in self._boards:
            with tempfile.TemporaryDirectory(dir=self._folder) as folder:
                file = Path(folder) / f"board.{form}"
                code, _, words = self._errands.run("calibrate", "board", "-o", file, "--board", name, "--paper", paper, seconds=_DRAWN)
                if code:
                    raise ValueError(words.removeprefix("rsvideo: "))
                if len(self._boards) > 8:
                    self._boards.clear()
                self._boards[key] = file.read_bytes()
        return _FORMS[form], self._boards[key]

    def session(self, id: str) -> Session:
        """The one of this number, or a new one for an empty one; KeyError."""
        if id:
            return self._sessions[id]
        while len(self._sessions) >= MOST_SESSIONS:
            old = self._sessions.pop(next(iter(self._sessions)))
            shutil.rmtree(old.folder, ignore_errors=True)
        session = Session(id=secrets.token_hex(8), folder=Path(tempfile.mkdtemp(dir=self._folder)))
        session.views.mkdir()
        self._sessions[session.id] = session
        return session

    async def take(self, session: Session, name: str, pieces: AsyncIterator[bytes]) -> None:
        """A file that was dropped in, piece by piece; ValueError where it may not be."""
        if not is_plain(name) or not name.lower().endswith((*PHOTOGRAPHS, *CLIP_SUFFIXES)):
            raise ValueError(f"{name[:80]!r} is no photograph or clip by its name; drop pictures of the board, or a clip")
        held = session.listed()
        if len(held) >= MOST_FILES:
            raise TooMuchError(f"at most {MOST_FILES} views are taken; twenty good ones are enough")
        left = min(MOST_BYTES, MOST_IN_ALL - sum(each["bytes"] for each in held))
        part = session.views / f".{secrets.token_hex(4)}"
        try:
            with part.open("xb") as file:
                async for piece in pieces:
                    left -= len(piece)
                    if left < 0:
                        raise TooMuchError(
                            f"{name} is too large: {MOST_BYTES // 10**6} MB a file, {MOST_IN_ALL // 10**9} GB in all are taken"
                        )
                    file.write(piece)
            part.replace(session.views / name)
        finally:
            part.unlink(missing_ok=True)

    def forget(self, session: Session, name: str) -> None:
        """Remove a view."""
        if any(each["name"] == name for each in session.listed()):
            (session.views / name).unlink()

    def measure_lens(self, session: Session, board: str, model: str, name: str) -> Errand:
        """Start measuring the lens on the views."""
        if not _BOARD.fullmatch(board) or model not in ("auto", "brown-conrady", "fisheye"):
            raise ValueError("a board is written like chessboard:9x6:25mm; a model is auto, brown-conrady or fisheye")
        files = [session.views / each["name"] for each in session.listed()]
        if not files:
            raise ValueError("there are no views; drop photographs of the board first, or a clip of it")
        words: list[object] = ["calibrate", "lens", *files, "--board", board, "--model", model, "--json", "-o", session.profile]
        words += ["--figure", session.folder / "residuals.png", "--overwrite", *self._kept(session, "lens"), *_named(name)]
        return self._start(session, "lens", words)

    def measure_readout(self, session: Session, clip: Path, hertz: str, name: str) -> Errand:
        """Start measuring the readout from a clip or photograph lit by a flickering light."""
        if not _HERTZ.fullmatch(hertz.strip()):
            raise ValueError(f"a flicker is written like 1000Hz, or 100Hz for lamps on mains, got {hertz[:40]!r}")
        words: list[object] = ["calibrate", "readout", clip, "--flicker", hertz.strip(), "--json", "-o", session.profile, "--overwrite"]
        return self._start(session, "readout", [*words, *self._kept(session, "readout"), *_named(name)])

    def found(self, session: Session, what: str) -> dict[str, Any] | None:
        """What a measurement printed, once it is done."""
        errand = session.errands.get(what)
        if errand is None or errand.state != "done":
            return None
        try:
            return json.loads(errand.output)
        except ValueError:
            return None

    def figure(self, session: Session, what: str) -> bytes:
        """A picture of a session: `residuals`, or `profile` drawn on one page; FileNotFoundError."""
        if what == "profile":
            file = session.folder / "profile.png"
            code, _, words = self._errands.run("calibrate", "show", session.profile, "-o", file, "--overwrite", seconds=_DRAWN)
            if code:
                raise ValueError(words.removeprefix("rsvideo: "))
            return file.read_bytes()
        return (session.folder / "residuals.png").read_bytes()

    def save(self, session: Session, folder: Path, name: str, *, overwrite: bool) -> Path:
        """Put the profile into a folder that was opened; ValueError, FileExistsError or OSError."""
        stem = name.removesuffix(".yaml").strip()
        if not is_plain(stem):
            raise ValueError(f"a profile's name must be a plain file name such as my_phone_1080p30, got {name[:80]!r}")
        if not session.profile.is_file():
            raise ValueError("nothing is measured yet; measure the lens or the readout first")
        path = folder / f"{stem}.yaml"
        if path.is_symlink() or path.is_dir():
            raise ValueError(f"{path.name} is a link or a folder; give the profile another name")
        check_free(path, overwrite=overwrite)
        with aside(folder) as within:
            place([made_within(within, path, session.profile.read_bytes())])
        return path

    def close(self) -> None:
        """Remove all that was dropped in."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _start(self, session: Session, what: str, words: list[object]) -> Errand:
        session.errands[what] = self._errands.start(f"{session.id} {what}", *words, seconds=SECONDS)
        return session.errands[what]

    def _kept(self, session: Session, what: str) -> tuple[str, ...]:
        """What the other measurement has found stays in the profile."""
        other = {"lens": "readout", "readout": "lens"}[what]
        return ("--add",) if self.found(session, other) is not None and session.profile.is_file() else ()


def _named(name: str) -> tuple[str, ...]:
    """The camera's model, if it is given."""
    if len(name) > 100 or any(letter < " " for letter in name):
        raise ValueError("a camera's name must be a line of at most 100 characters")
    return ("--name", name.strip()) if name.strip() else ()
