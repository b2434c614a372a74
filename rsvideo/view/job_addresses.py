"""What the pages of jobs and reports ask for."""

from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict, Field

from rsvideo.config.files import UnreadableError, read_whole
from rsvideo.report import embedded
from rsvideo.view.app import Room
from rsvideo.view.jobs import MOST_WORKERS

_MOST_REPORT = 100_000_000  # bytes
_MOST_REPORTS = 200
_READ_AS_TEXT = (".csv", ".json")


class JobWish(BaseModel):
    """A job to be steered."""

    model_config = ConfigDict(extra="forbid")

    at: Annotated[str, Field(max_length=4000)]


class StartWish(JobWish):
    """A job to be started."""

    workers: Annotated[int, Field(ge=1, le=MOST_WORKERS)] = 1
    overwrite: bool = False
    fresh: bool = False


def router(room: Room) -> APIRouter:
    """The addresses."""
    here = APIRouter()

    @here.get("/api/jobs")
    def jobs() -> dict[str, Any]:
        return {"jobs": room.jobs.listed()}

    @here.post("/api/jobs/start")
    def start(wish: StartWish) -> dict[str, Any]:
        room.jobs.start(room.opened.path(wish.at), workers=wish.workers, overwrite=wish.overwrite, fresh=wish.fresh)
        return jobs()

    @here.post("/api/jobs/pause")
    def pause(wish: JobWish) -> dict[str, Any]:
        room.jobs.steer(room.opened.path(wish.at), "pause")
        return jobs()

    @here.post("/api/jobs/resume")
    def resume(wish: JobWish) -> dict[str, Any]:
        room.jobs.steer(room.opened.path(wish.at), "go")
        return jobs()

    @here.post("/api/jobs/cancel")
    def cancel(wish: JobWish) -> dict[str, Any]:
        room.jobs.steer(room.opened.path(wish.at), "cancel")
        return jobs()

    _add_reports(here, room)
    return here


def _add_reports(here: APIRouter, room: Room) -> None:
    @here.get("/api/reports")
    def reports() -> dict[str, Any]:
        found = [path for path in room.opened.below() if path.name == "report.json" and (path.parent / "index.html").is_file()]
        places = [room.opened.at(path.parent) for path in found[:_MOST_REPORTS]]
        return {"reports": [{"name": Path(at).name or at, "address": f"report/{quote(at)}/index.html"} for at in places]}

    @here.get("/report/{at:path}")
    def report(at: str) -> Response:
        path = room.opened.path(at)
        ours = any((folder / "report.json").is_file() for folder in (path.parent, path.parent.parent) if room.opened.holds(folder))
        if not ours or path.suffix not in (".html", *_READ_AS_TEXT):
            raise UnreadableError(f"{path.name} is no part of a report that rsvideo compare wrote")
        data = read_whole(path, most=_MOST_REPORT)
        if path.suffix in _READ_AS_TEXT:
            return Response(data, media_type="text/plain; charset=utf-8")
        # only the script that this version of rsvideo puts into reports may run, and that far away from these pages
        policy = f"{embedded.policy(embedded.text('page.css'), embedded.text('page.js'))}; frame-ancestors 'none'; sandbox allow-scripts"
        headers = {"content-security-policy": policy, "cross-origin-opener-policy": "unsafe-none"}
        return Response(data, media_type="text/html; charset=utf-8", headers=headers)
