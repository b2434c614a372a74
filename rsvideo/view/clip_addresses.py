"""What the list of clips and the page of a clip ask for."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, ConfigDict, Field

from rsvideo.config.files import UnreadableError
from rsvideo.config.media import is_clip
from rsvideo.config.request import Sections, option_fields
from rsvideo.view import fields, glance, job_text, sidecars, trial
from rsvideo.view.app import Room
from rsvideo.view.fields import Stated
from rsvideo.view.glance import Facts, Strip
from rsvideo.view.trial import MOST_FRAMES, Measuring, Trial

_WAIT = 15.0  # seconds that a page waits for news at a time
_TRACKED = 6 * 3600.0  # seconds that finding a motion may take

Place = Annotated[str, Query(max_length=4000)]
Side = Annotated[int, Query(ge=32, le=2560)]
Settings = dict[str, dict[str, str | bool | int | float | None]]


class Wish(BaseModel):
    """A clip and its settings."""

    model_config = ConfigDict(extra="forbid")

    at: Annotated[str, Field(max_length=4000)]
    settings: Settings = {}


class TrialWish(Wish):
    """Frames to be tried."""

    first: Annotated[int, Field(ge=0, le=10**9)] = 0
    last: Annotated[int, Field(ge=0, le=10**9)] = 0


class SaveWish(Wish):
    """Settings to be saved as a job."""

    name: Annotated[str, Field(max_length=200)]
    sources: dict[str, Annotated[str, Field(max_length=500)]] = {}
    overwrite: bool = False


def router(room: Room) -> APIRouter:
    """The addresses."""
    here = APIRouter(prefix="/api")
    _add_lists(here, room)
    _add_trials(here, room)
    _add_strips(here, room)

    @here.post("/save")
    def save(wish: SaveWish) -> dict[str, str]:
        path = _source(room, wish.at)
        _sections(room, path, wish.settings)
        content = job_text.text(path.name, _beside(wish.settings), wish.sources)
        made = job_text.save(path.parent, wish.name, content, overwrite=wish.overwrite)
        return {"at": room.opened.at(made), "name": made.name, "text": content}

    return here


def _add_lists(here: APIRouter, room: Room) -> None:
    @here.get("/folder")
    def folder(at: Place = "") -> dict[str, Any]:
        place = at or room.opened.start
        path = room.opened.path(place)
        if path.is_file():  # a job was opened
            place = room.opened.at(path.parent)
            path = path.parent
        names, more = room.opened.listed(place)
        number = int(place.partition("/")[0])
        top = room.opened.folders[number]
        trail = [{"name": top.name or str(top), "at": f"{number}/"}]
        for depth in range(1, len(path.relative_to(top).parts) + 1):
            within = Path(*path.relative_to(top).parts[:depth])
            trail.append({"name": within.name, "at": f"{number}/{within.as_posix()}"})
        others = [{"name": each.name or str(each), "at": f"{n}/"} for n, each in enumerate(room.opened.folders)]
        return {"trail": trail, "names": [asdict(name) for name in names], "more": more, "folders": others}

    @here.get("/thumb")
    def thumb(at: Place, side: Side = 320) -> Response:
        kind, data = room.album.thumbnail(_source(room, at), side)
        return Response(data, media_type=kind, headers={"cache-control": "private, max-age=300"})

    @here.get("/frame")
    def frame(at: Place, index: Annotated[int, Query(ge=0, le=10**9)] = 0, side: Side = 1280) -> Response:
        kind, data = room.album.frame(_source(room, at), index, side)
        return Response(data, media_type=kind, headers={"cache-control": "private, max-age=300"})

    @here.post("/facts")
    def facts(wish: Wish) -> dict[str, Any]:
        path = _source(room, wish.at)
        wanted = _sections(room, path, wish.settings)
        room.desk.warm()
        found = room.glancing.one(Facts(path=path, sections=wanted), seconds=glance.SECONDS)
        return {"name": path.name, "facts": found, "fields": fields.listed(path), "most_frames": MOST_FRAMES}


def _add_trials(here: APIRouter, room: Room) -> None:
    @here.post("/preview")
    def preview(wish: TrialWish) -> dict[str, Any]:
        path = _source(room, wish.at)
        wanted = _sections(room, path, wish.settings)
        if not wish.first <= wish.last < wish.first + MOST_FRAMES:
            raise ValueError(f"a preview is of 1 to {MOST_FRAMES} frames, got {wish.first} to {wish.last}; save a job for more")
        request = fields.request(path, trial.somewhere(room.state, path, is_clip=is_clip(path)), wanted)
        order = Trial(request=request, first=wish.first, last=wish.last)
        order = Trial(request=request.replaced(measured=room.desk.measured(order.measured_key)), first=wish.first, last=wish.last)
        stamp = path.stat().st_mtime_ns
        return room.desk.want((path, stamp, repr(wanted.stated()), wish.first, wish.last), order).values()

    @here.post("/measure")
    def measure(wish: Wish) -> dict[str, Any]:
        path = _source(room, wish.at)
        if not is_clip(path):
            raise ValueError("a photograph does not show its own exposure or readout; type them in")
        wanted = _sections(room, path, wish.settings)
        order = Measuring(facts=Facts(path=path, sections=wanted, measure=True))
        return room.desk.want(("measure", path, path.stat().st_mtime_ns, repr(wanted.stated())), order).values()

    @here.get("/preview/{id}")
    def news(id: str, version: int = -1) -> dict[str, Any]:
        return room.desk.wait(room.desk.get(id), version, _WAIT)

    @here.get("/preview/{id}/{name}")
    def picture(id: str, name: str) -> Response:
        kind, data = room.desk.get(id).pictures[name]
        return Response(data, media_type=kind, headers={"cache-control": "private, max-age=3600"})


def _add_strips(here: APIRouter, room: Room) -> None:
    @here.get("/strip")
    def strip(at: Place, which: Annotated[int, Query(ge=0, le=400)] = 0) -> dict[str, Any]:
        path = _source(room, at)
        found = sidecars.of(path, room.opened, room.tracks)
        listed = [
            {"what": each.what, "result": room.opened.at(each.result) if each.result and room.opened.holds(each.result) else None}
            for each in found
        ]
        drawn = room.glancing.one(Strip(path=found[which].path), seconds=glance.SECONDS) if which < len(found) else None
        return {"sidecars": listed, "strip": drawn}

    @here.post("/track")
    def track(wish: Wish) -> dict[str, Any]:
        path = _source(room, wish.at)
        if not is_clip(path):
            raise ValueError("motion is found between the frames of a clip; a photograph's preview finds its own")
        wanted = _sections(room, path, wish.settings)
        words = ["track", path, "-o", sidecars.track_file(path, room.tracks), "--overwrite", *_options(wanted)]
        return room.errands.start("track", *words, seconds=_TRACKED).values()

    @here.get("/errand/{id}")
    def errand(id: str, version: int = -1) -> dict[str, Any]:
        return room.errands.wait(room.errands.get(id), version, _WAIT)

    @here.post("/errand/{id}/cancel")
    def cancel(id: str) -> dict[str, Any]:
        room.errands.cancel(room.errands.get(id))
        return room.errands.get(id).values()


def _source(room: Room, at: str) -> Path:
    path = room.opened.path(at)
    if not path.exists():
        raise UnreadableError(f"{path.name} is not there any more; go back to the list of clips")
    return path


def _sections(room: Room, path: Path, settings: Stated) -> Sections:
    return fields.sections(settings, path, room.opened)


def _beside(settings: Stated) -> Stated:
    """The settings as they are typed, without those that are left to the default."""
    return {
        section: {name: value for name, value in given.items() if value not in (None, "", False)}
        for section, given in settings.items()
        if any(value not in (None, "", False) for value in given.values())
    }


def _options(wanted: Sections) -> list[str]:
    """The options of `rsvideo track` that state the same."""
    words = []
    for each in option_fields():
        if (each.section in ("camera", "input") or each.key == "motion.model") and each.name in wanted.stated().get(each.section, {}):
            value = wanted.value(each)
            if value is True:
                words.append(each.flag)
            elif value is not None and value is not False:
                words += [each.flag, f"{value:.9g}" if isinstance(value, float) else str(getattr(value, "value", value))]
    return words
