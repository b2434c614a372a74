"""From what a user states to what the pipeline takes: the one file of this room that builds requests."""

import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from rsvideo.api.camera import Camera
from rsvideo.api.settings import Settings
from rsvideo.api.shutter import Shutter
from rsvideo.api.words import transfer_named
from rsvideo.config import media, sidecar
from rsvideo.config.quantity import frame_rate
from rsvideo.config.request import Request
from rsvideo.frame import Frame
from rsvideo.physics.tone import Tone, Transfer
from rsvideo.pipeline import devices, prepare, take
from rsvideo.pipeline.methods import Treatment
from rsvideo.pipeline.prepare import Task
from rsvideo.pipeline.take import Take
from rsvideo.pipeline.tracked import Tracked
from rsvideo.shooting import profiles

Response = tuple[Tone | None, float | None]  # the curve of codes, and the code in [0, 1] from which on highlights are lost


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What a user states of a photograph or a clip, beside its pictures."""

    shutter: Shutter
    camera: Camera
    settings: Settings
    rate: Fraction | None  # frames a second
    transfer: Transfer | None  # what codes mean
    motion: Path | None  # the file that gives it
    moved: bool  # whether the motion is given, in a file or as a value
    found: Tracked | None = None  # with what it was found, if it is a clip's and given as a value
    force: bool = False  # whether times are taken as stated, whatever the clip shows

    @staticmethod
    def of(
        shutter: Shutter | None,
        camera: Camera | None,
        settings: Settings | None,
        *,
        rate: float | str | Fraction | None = None,
        transfer: str | None = None,
        motion: Path | None = None,
        moved: bool = False,
        found: Tracked | None = None,
        force: bool = False,
    ) -> "Stated":
        """The arguments of the public functions; ValueError where a word or a number cannot be meant."""
        return Stated(
            shutter=shutter or Shutter(),
            camera=camera or Camera(),
            settings=settings or Settings(),
            rate=pictures_a_second(rate),
            transfer=transfer_named(transfer),
            motion=motion,
            moved=moved,
            found=found,
            force=force,
        )


@dataclass(frozen=True, kw_only=True)
class Stored:
    """What pictures state themselves: their size, and what their file holds."""

    name: str  # as errors call it
    rows: int
    cols: int
    rate: Fraction | None = None  # frames a second; None of a photograph
    exposure: float | None = None  # seconds, by EXIF
    focal_px: float | None = None  # by EXIF


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """How pictures of one size are restored, and what their codes mean."""

    treatment: Treatment
    response: Response  # of the profile
    notes: tuple[str, ...]


def prepared(stated: Stated, stored: Stored, frames: Callable[[Response], Iterable[Frame]] | None = None) -> Prepared:
    """Timing, lens and tone of pictures that are arrays; ValueError where something is missing.

    `frames` opens those of a clip's `measuring.middle`, whose codes mean light by the profile's response.
    """
    profile = None if stated.camera.profile is None else profiles.find(stated.camera.profile)
    rate = None if stored.rate is None else float(stored.rate)
    taken = take.of_pictures(profile, stored.rows, stored.cols, fps=rate, exposure=stored.exposure, focal=stored.focal_px)
    response = (taken.profile.tone, taken.profile.saturation) if taken.profile else (None, None)
    request = _request(Path(stored.name), replace(stated, motion=stated.motion or (Path("given") if stated.moved else None)))
    devices.check(request)
    if frames is None:
        _check_complete(stated.shutter, taken, stored.name)
    else:
        request, taken = prepare.measured(request, taken, lambda: frames(response))
    shutter, lens, notes = prepare.taken_by(request, taken, stated.found)
    settings = prepare.settings_of(request.motion, request.deblur)
    return Prepared(
        treatment=prepare.treatment(request, settings, shutter, _bent(stated, lens)),
        response=response,
        notes=(*taken.notes, *notes),
    )


def _check_complete(shutter: Shutter, taken: Take, name: str) -> None:
    if shutter.exposure is None and taken.shutter.exposure is None:
        raise ValueError(f"exposure must be given, {name} does not say it; Shutter(exposure='1/50') is a time")
    if shutter.readout is None and taken.shutter.profile_readout is None:
        raise ValueError(
            f"readout must be given, {name} does not say it; a phone's or DSLR's video often reads in 10ms to 30ms, 0 is a global shutter"
        )


def _bent(stated: Stated, lens: sidecar.Camera) -> sidecar.Camera:
    """The lens with the distortion that the user states."""
    return sidecar.Camera.of(stated.camera.bent(lens.intrinsics), lens.source, lens.sensor_noise)


def of_path(path: Path, stated: Stated) -> Task:
    """A clip's file or folder, as the command prepares it; nothing is written to the output that it is given."""
    if not media.is_clip(path):
        raise ValueError(f"{path} is taken for a photograph, clips are .mp4, .mov, .mkv or folders; deblur(read(path)) takes photographs")
    task = prepare.prepare(_request(path, stated), found=stated.found)
    return replace(task, camera=_bent(stated, task.camera))


def pictures_a_second(rate: float | str | Fraction | None) -> Fraction | None:
    """Of a clip, as users write it: 24, 23.976, "24000/1001"."""
    return None if rate is None else frame_rate(str(rate))


def _request(source: Path, stated: Stated) -> Request:
    """The command's request; its output is never written."""
    shutter, camera = stated.shutter, stated.camera
    motion, deblur = stated.settings.sections()
    return Request.model_validate(
        {
            "source": source,
            "output": Path(tempfile.gettempdir()) / "rsvideo-not-written.mkv",
            "overwrite": True,
            "input": {"rate": None if stated.rate is None else str(stated.rate)},
            "camera": {
                "profile": camera.profile,
                "exposure": shutter.exposure,
                "readout": shutter.readout,
                "direction": shutter.direction,
                "focal_px": camera.focal_px,
                "transfer": stated.transfer,
                "force": stated.force,
            },
            "motion": motion.model_copy(update={"trajectory": stated.motion}),
            "deblur": deblur,
            "encoding": {"codec": "ffv1"},  # which holds all there is
        }
    )
