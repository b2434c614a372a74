"""What the page for calibration asks for."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from rsvideo.view.app import Room

Session = Annotated[str, Field(max_length=40)]
Line = Annotated[str, Field(max_length=200)]


class SessionWish(BaseModel):
    """What concerns one camera that is measured."""

    model_config = ConfigDict(extra="forbid")

    session: Session = ""


class LensWish(SessionWish):
    """The lens is to be measured."""

    board: Line
    model: Line = "auto"
    name: Line = ""


class ReadoutWish(SessionWish):
    """The readout is to be measured: from a clip in a folder that was opened, or one that was dropped in."""

    clip: Annotated[str, Field(max_length=4000)]
    dropped: bool = False
    flicker: Line
    name: Line = ""


class NameWish(SessionWish):
    """A name, of a view to be forgotten or of a profile to be saved."""

    name: Line
    at: Annotated[str, Field(max_length=4000)] = "0/"
    overwrite: bool = False


def router(room: Room) -> APIRouter:
    """The addresses."""
    here = APIRouter(prefix="/api")
    bench = room.bench

    @here.get("/calibrate/board")
    def board(name: Annotated[str, Query(max_length=200)], paper: str = "A4", form: str = "svg") -> Response:
        kind, data = bench.board(name, paper, form)
        headers = {} if form == "svg" else {"content-disposition": f'attachment; filename="board.{form}"'}
        return Response(data, media_type=kind, headers=headers)

    @here.post("/calibrate/session")
    def session(wish: SessionWish) -> dict[str, Any]:
        held = bench.session(wish.session)
        found = {what: bench.found(held, what) for what in ("lens", "readout")}
        errands = {what: errand.values() for what, errand in held.errands.items()}
        return {"session": held.id, "views": held.listed(), "found": found, "errands": errands, "profile": held.profile.is_file()}

    @here.put("/upload/{session}/{name}")
    async def upload(session: str, name: str, request: Request) -> dict[str, Any]:
        held = bench.session(session or "none")
        await bench.take(held, name, request.stream())
        return {"views": held.listed()}

    @here.post("/calibrate/forget")
    def forget(wish: NameWish) -> dict[str, Any]:
        held = bench.session(wish.session or "none")
        bench.forget(held, wish.name)
        return {"views": held.listed()}

    @here.post("/calibrate/lens")
    def lens(wish: LensWish) -> dict[str, Any]:
        return bench.measure_lens(bench.session(wish.session or "none"), wish.board, wish.model, wish.name).values()

    @here.post("/calibrate/readout")
    def readout(wish: ReadoutWish) -> dict[str, Any]:
        held = bench.session(wish.session or "none")
        if wish.dropped:
            names = [each["name"] for each in held.listed()]
            if wish.clip not in names:
                raise ValueError("this clip was not dropped in; drop it again")
            path = held.views / wish.clip
        else:
            path = room.opened.path(wish.clip)
        return bench.measure_readout(held, path, wish.flicker, wish.name).values()

    @here.get("/calibrate/figure/{session}/{what}")
    def figure(session: str, what: str) -> Response:
        return Response(bench.figure(bench.session(session or "none"), what), media_type="image/png")

    @here.post("/calibrate/save")
    def save(wish: NameWish) -> dict[str, str]:
        made = bench.save(bench.session(wish.session or "none"), room.opened.path(wish.at), wish.name, overwrite=wish.overwrite)
        return {"at": room.opened.at(made), "name": made.name}

    return here
