"""The pages and what they ask for, as addresses."""

from collections.abc import Awaitable, Callable, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.exceptions import HTTPException

from rsvideo.config.files import UnreadableError
from rsvideo.config.lock import BusyError
from rsvideo.config.printable import printable
from rsvideo.pipeline import processes
from rsvideo.report import embedded
from rsvideo.view import glance
from rsvideo.view.calibrating import Bench, TooMuchError
from rsvideo.view.child import Child, FailedError
from rsvideo.view.errands import COMMAND, Errands
from rsvideo.view.fields import SettingsError
from rsvideo.view.jobs import Jobs
from rsvideo.view.opened import Opened, OutsideError
from rsvideo.view.previews import Desk
from rsvideo.view.thumbnails import Album

PAGES = {"/": "folder", "/clip": "clip", "/jobs": "jobs", "/calibrate": "calibrate"}
_STATIC = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


class Room:
    """All that the pages stand on."""

    def __init__(self, opened: Opened, state: Path, command: Sequence[str] = COMMAND) -> None:
        self.opened, self.state = opened, state
        self.tracks = state / "tracks"
        self.tracks.mkdir(parents=True, exist_ok=True, mode=0o700)
        self.errands = Errands(command)
        self.bench = Bench(self.errands)
        self.jobs = Jobs(opened, state, command)
        self.desk = Desk()
        self.glancing = Child(glance.carry_out, threads=max(1, processes.cores() // 2))
        self.album = Album(self.glancing)

    def close(self) -> None:
        """End all that was started but runs, which go on."""
        self.errands.close()
        self.desk.close()
        self.glancing.close()
        self.bench.close()


class Plain(JSONResponse):
    """Values for a page, in whose words nothing acts: control characters and turns of the writing direction are written out.

    What names a file, under the key `at` or one that ends in `_at`, stays as it is.
    """

    def render(self, content: Any) -> bytes:
        return super().render(_plain(content))


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value, keep="\n")
    if isinstance(value, dict):
        return {key: each if key == "at" or key.endswith("_at") else _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list) else value


def application(room: Room) -> FastAPI:
    """The application, without a page of its own documentation, which would need a network."""
    from rsvideo.view import calibration_addresses, clip_addresses, job_addresses

    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, default_response_class=Plain)
    _add_faults(app)
    _add_pages(app)
    app.include_router(clip_addresses.router(room))
    app.include_router(job_addresses.router(room))
    app.include_router(calibration_addresses.router(room))
    return app


def text(name: str) -> str:
    """A style, script or picture that stands beside this module, or the report's style."""
    if name == "report.css":
        return embedded.text("page.css")
    return resources.files("rsvideo.view").joinpath("static", name).read_text(encoding="utf-8")


def _add_pages(app: FastAPI) -> None:
    templates = Environment(
        loader=PackageLoader("rsvideo.view"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    for address, name in PAGES.items():
        _add_page(app, address, templates.get_template(f"{name}.html").render())

    @app.get("/static/{name}")
    def static(name: str) -> Response:
        kind = next((kind for suffix, kind in _STATIC.items() if name.endswith(suffix)), None)
        if kind is None or "/" in name or name.startswith("."):
            return fault(404, "there is no such file; reload the page")
        try:
            return Response(text(name), media_type=kind)
        except FileNotFoundError:
            return fault(404, "there is no such file; reload the page")


def _add_page(app: FastAPI, address: str, text: str) -> None:
    @app.get(address)
    def page() -> Response:
        return Response(text, media_type="text/html")


def fault(number: int, words: str, **more: Any) -> JSONResponse:
    """An error as the pages show it: one sentence."""
    return JSONResponse({"error": printable(" ".join(words.split()))[:2000], **more}, status_code=number)


def _add_faults(app: FastAPI) -> None:
    numbers: dict[type[Exception], int] = {
        OutsideError: 403,
        UnreadableError: 422,
        FileExistsError: 409,
        BusyError: 409,
        FailedError: 422,
        TooMuchError: 413,
        ValueError: 422,
    }

    def answer(number: int) -> Callable[[Request, Exception], Awaitable[Response]]:
        async def answered(_: Request, error: Exception) -> Response:
            words = str(error).replace("; give --overwrite to replace it", "; choose another name, or allow replacing it")
            return fault(number, words, faults=error.faults if isinstance(error, SettingsError) else {})

        return answered

    for kind, number in numbers.items():
        app.add_exception_handler(kind, answer(number))

    @app.exception_handler(RequestValidationError)
    async def invalid(_: Request, error: RequestValidationError) -> Response:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"][1:])
        return fault(422, f"the page sent {place or 'something'} that cannot be meant ({first['msg'].lower()}); reload it")

    @app.exception_handler(HTTPException)
    async def unusual(_: Request, error: HTTPException) -> Response:
        words = {404: "there is no such page; go back to the list of clips"}
        otherwise = "this cannot be done with that address; use the pages of rsvideo view itself"
        return fault(error.status_code, words.get(error.status_code, otherwise))

    @app.exception_handler(KeyError)
    async def gone(_: Request, __: Exception) -> Response:
        return fault(404, "this is not kept any more; start it again")

    @app.exception_handler(OSError)
    async def system(_: Request, error: OSError) -> Response:
        name = Path(str(error.filename)).name if error.filename else "a file"
        return fault(500, f"{name} could not be read or written: {error.strerror or error}; is there room, and is it yours?")

    @app.exception_handler(Exception)
    async def unexpected(_: Request, error: Exception) -> Response:
        return fault(500, f"failed while working: {type(error).__name__}; the terminal with rsvideo view may say more")
