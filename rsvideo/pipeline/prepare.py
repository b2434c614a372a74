"""From a request to a task: every question that a request leaves open is answered before the work.

A photograph is one frame without neighbours; what else differs is how it is opened (`take`, `clip_facts`).
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rsvideo.config import media, names, sidecar
from rsvideo.config.files import UnreadableError
from rsvideo.config.method import Method
from rsvideo.config.request import Camera, Deblur, Measured, Motion, Request
from rsvideo.frame import SMALLEST, Frame
from rsvideo.physics import camera as physics
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline import devices, gyro_alignment, output, piping, take
from rsvideo.pipeline.gyro_alignment import Gyro
from rsvideo.pipeline.methods import Treatment
from rsvideo.pipeline.take import Opened, Take, Taken
from rsvideo.pipeline.tracked import Tracked, tracked
from rsvideo.restoration import exposure
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import timing, usual
from rsvideo.stills.still import Format, Still

if TYPE_CHECKING:
    from rsvideo.video.output_format import Encoding
    from rsvideo.video.stream import Stream

_WIDEST = 0.2  # focal length per longer side: a field of view of 136 degrees
_SECONDS_A_PIXEL = 2e-5  # of work, roughly, on two cores
_NO_SHUTTER = Camera(exposure=1e-3, readout=0.0, force=True)  # of the method none, which does not use it


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A request whose every question is answered."""

    request: Request
    source: "Still | Stream"
    shutter: timing.Resolved
    camera: sidecar.Camera
    settings: Settings
    gyro: Gyro | None
    encoding: "Encoding | None"  # of a clip that is written
    first: int  # frames [first, last) are restored
    last: int
    notes: tuple[str, ...]  # what the user should know before the work

    @property
    def still(self) -> Still:
        """The photograph."""
        assert isinstance(self.source, Still)
        return self.source

    @property
    def stream(self) -> "Stream":
        """The clip."""
        assert not isinstance(self.source, Still)
        return self.source

    @property
    def timing(self) -> ShutterTiming:
        """Of every frame."""
        return self.shutter.timing

    @property
    def timing_source(self) -> str:
        """Who stated it."""
        return self.shutter.source

    @property
    def frames(self) -> int:
        """How many are restored."""
        return self.last - self.first

    @property
    def rows(self) -> int:
        """As stored."""
        return self.camera.rows

    @property
    def cols(self) -> int:
        """As stored."""
        return self.camera.cols

    @property
    def treatment(self) -> Treatment:
        """What is done to the frames."""
        bits = math.inf if isinstance(self.source, Still) else self.source.bits
        return replace(treatment(self.request, self.settings, self.shutter, self.camera), gyro=self.gyro, bits=bits)

    @property
    def picture_bytes(self) -> int:
        """Of a picture as decoded."""
        if isinstance(self.source, Still):
            return self.source.codes.samples.nbytes
        from rsvideo.pipeline import clip_frames

        return clip_frames.picture_bytes(self.source)

    def estimate(self) -> tuple[float, int]:
        """Seconds of work and bytes of disk while it lasts, roughly."""
        pixels = self.frames * self.rows * self.cols
        nothing = self.request.deblur.method is Method.NONE
        return 0.0 if nothing else pixels * _SECONDS_A_PIXEL, self.frames * self.picture_bytes


def prepare(request: Request, piped: "Stream | None" = None, found: Tracked | None = None) -> Task:
    """Open the source and settle timing, camera and encoding; raises ValueError, UnreadableError or FileExistsError.

    `piped` is what a pipe has brought, if that is the source. `found` is what is stated of a motion that is given, but not in a file.
    """
    check(request)
    request = devices.settled(request)
    opened = _opened(request, piped)
    rows, cols = opened.shutter.rows, opened.shutter.cols
    if min(rows, cols) < SMALLEST:
        raise UnreadableError(
            f"{request.source} must be at least {SMALLEST} x {SMALLEST} px, it is {cols} x {rows};"
            " so small a picture has nothing to measure motion by"
        )
    first, last, encoding, written = _frames_and_encoding(request, opened)
    if found is None:
        request, opened = measured(request, opened, lambda: _middle(request, opened, first, last))
    shutter, camera, notes = taken_by(request, opened, found)
    wanted = treatment(request, settings_of(request.motion, request.deblur), shutter, camera)
    gyro = _gyro(request, opened, (first, last), wanted.camera, wanted.settings)
    if gyro:  # which need not be looked for again
        request = request.replaced(motion={"gyro_offset": gyro.offset, "gyro_axes": gyro.axes})
    return Task(
        request=request,
        source=opened.source,
        shutter=shutter,
        camera=camera,
        settings=wanted.settings,
        gyro=gyro,
        encoding=encoding,
        first=first,
        last=last,
        notes=(
            *opened.notes,
            *notes,
            *((gyro.note,) if gyro and gyro.note else ()),
            *written,
        ),
    )


def taken_by(request: Request, take: Take, found: Tracked | None = None) -> tuple[timing.Resolved, sidecar.Camera, tuple[str, ...]]:
    """Shutter, camera and what to know of both: those with which the motion was found, if it was found before."""
    stated = _NO_SHUTTER if request.deblur.method is Method.NONE else request.camera
    if take.of_clip and (found := found or tracked(request.motion.trajectory)):
        shutter = found.taken_by(request.camera, take.shutter, request.source)
        return shutter, found.camera, shutter.notes
    shutter = timing.resolve(stated, take.shutter)
    camera, notes = _camera_of(request, take)
    return shutter, camera, (*_unclear(request, shutter), *shutter.notes, *notes)


def measured(request: Request, take: Taken, frames: Callable[[], Iterable[Frame]]) -> tuple[Request, Taken]:
    """The same with what the clip's own frames show of its shutter and lens, where that is needed and was not measured before.

    Every method needs what nobody states; our own checks an exposure that is typed in even where all is stated. `frames` opens those of
    the clip's `measuring.middle`.
    """
    if not take.of_clip or not measurable(request):
        return request, take
    from rsvideo.pipeline import measuring

    if request.measured is None:
        ours = request.deblur.method is Method.RSVIDEO
        if (request.preview or not ours) and not measuring.unstated(request.camera, take.shutter):
            return request, take
        if request.preview:  # which shows what is assumed; a job measures it
            return request, measuring.settled(take, Measured())
        request = request.replaced(measured=measuring.of_frames(take, request.camera, frames))
    return request, measuring.settled(take, request.measured)


def measurable(request: Request) -> bool:
    """Whether a clip's own frames may show its shutter: not beside a motion that is given, and not where each frame is on its own."""
    return request.deblur.method is not Method.NONE and request.motion.trajectory is None and request.deblur.frames != "cold"


def _middle(request: Request, opened: Opened, first: int, last: int) -> Iterable[Frame]:
    from rsvideo.pipeline import measuring

    return measuring.frames_of(opened, first, last, request.input.on_damage)


def _unclear(request: Request, shutter: timing.Resolved) -> tuple[str, ...]:
    """What could not be measured and is assumed."""
    if request.measured is None or not any(fact.assumed for fact in (shutter.exposure, shutter.readout)):
        return ()
    named = (("exposure", shutter.exposure), ("readout", shutter.readout))
    taken = ", ".join(f"{name} {1e3 * fact.value:.3g} ms" if fact.value else f"no {name}" for name, fact in named if fact.assumed)
    return (f"the clip does not show all of its timing ({'; '.join(request.measured.unclear)}): {taken} is assumed",)


def check(request: Request) -> None:
    """Refuse what can be refused before anything is read."""
    names.check(*request.files)
    method = request.deblur.method
    piping.check(request)
    if request.motion_only:
        _check_motion(request)
    elif request.preview and request.is_clip:
        _check_preview(request)
    elif not request.is_clip:
        taken = f"{request.source} is taken for a photograph"
        if wrong := next(iter(request.of_clips()), None):
            raise ValueError(f"{wrong.flag} concerns clips, {taken}; clips are .mp4, .mov, .mkv or folders")
        Format.of_output(request.output)
        output.check_kind(request.output, folder=False)
        if method.needs_clip:
            raise ValueError(f"method {method} concerns clips, it sees the motion between frames; {taken}")
    output.check(request)
    devices.check(request)
    if request.motion.states_gyro and not method.follows_gyro:
        raise ValueError(f"a gyroscope's log is read by the methods {Method.GYRO} and {Method.GYRO_REFINE}, not by {method}")
    if method.steadied:
        from rsvideo.video import vidstab

        if not vidstab.available():
            raise ValueError(f"the method {method} needs imageio-ffmpeg; pip install 'rsvideo[vidstab]' brings it")


def _check_motion(request: Request) -> None:
    if not request.is_clip:
        raise ValueError(f"{request.source} is taken for a photograph, motion is found between the frames of a clip; deblur finds its own")
    if request.output.suffix.lower() != ".json":
        raise ValueError(f"OUTPUT must end in .json, by which --trajectory knows a sidecar, got {request.output}")
    output.check_kind(request.output, folder=False)


def _check_preview(request: Request) -> None:
    if media.is_pipe(request.source):
        raise ValueError("a preview is of a frame from the middle of INPUT, - is a pipe, which is read in order; give a file")
    Format.of_output(request.output)
    output.check_kind(request.output, folder=False)


def _opened(request: Request, piped: "Stream | None") -> Opened:
    if not request.is_clip:
        return take.of_photograph(request)
    from rsvideo.pipeline import clip_facts

    return clip_facts.opened(request, piped)


def _frames_and_encoding(request: Request, opened: Opened) -> "tuple[int, int, Encoding | None, tuple[str, ...]]":
    """Which frames are restored, and how they are written; a photograph is written as its name says."""
    if isinstance(opened.source, Still):
        return 0, 1, None, ()
    from rsvideo.pipeline import clip_facts
    from rsvideo.video import pipe, sequence
    from rsvideo.video.output_format import SEQUENCES, Encoding, check_times, chosen
    from rsvideo.video.part import Part

    first, last = clip_facts.frame_range(opened.source, request.input.range)
    if request.motion_only or request.preview:
        return first, last, None, ()
    wanted, layout = request.encoding, request.encoding.pixel_format
    if opened.source.bare and request.pipe.format == "rawvideo" and not media.is_pipe(request.output):
        layout = "same"  # for the pipe's own is what was stated
    codec = request.pipe.format if media.is_pipe(request.output) else wanted.codec
    encoding = Encoding(codec=codec, crf=wanted.crf, pixel_format=layout)
    codec, _, notes = chosen(request.output, opened.source, encoding)
    output.check_kind(request.output, folder=codec in SEQUENCES)
    if codec in SEQUENCES:
        sequence.older(request.output, opened.source)  # refuses what must stay
    check_times(request.output, Part(stream=opened.source, first=first, last=last))
    if media.is_pipe(request.output):
        notes += (pipe.lost(opened.source),)
    return first, last, encoding, notes


def treatment(request: Request, settings: Settings, shutter: timing.Resolved, camera: sidecar.Camera) -> Treatment:
    """What a request says is done, by its settings and what was measured, to pictures that were taken so; but for a gyroscope's log."""
    found = request.measured
    guessed = bool(found and found.readout_guessed)
    return Treatment(
        method=request.deblur.method,
        settings=settings,
        block_rows=request.deblur.block_rows,
        gyro=None,
        camera=physics.Camera(timing=shutter.timing, intrinsics=camera.intrinsics, noise=camera.sensor_noise),
        timing_source=shutter.source,
        exposure_shown=bool(found and found.exposure and (shutter.by_blur or not timing.apart(shutter.exposure.value, found.exposure))),
        readout_guessed=guessed,
        exposure_doubtful=not (request.camera.force or guessed),
        exposure_spread=_exposure_spread(shutter, readout_guessed=guessed),
    )


def _exposure_spread(shutter: timing.Resolved, *, readout_guessed: bool) -> float | None:
    """A treatment's. Where a job's frames show no readout, not even a likely one, their path shows no exposure."""
    if not shutter.exposure_open:
        return None
    if not shutter.exposure.assumed:
        return exposure.ABOUT
    return None if readout_guessed else math.inf


def settings_of(motion: Motion, deblur: Deblur) -> Settings:
    """What a request says of the restoration, for the room that restores."""
    return Settings(
        motion=motion.model,
        degree=motion.degree,
        start=motion.start,
        refinement=motion.refinement,
        prior=deblur.prior,
        quality=deblur.quality,
        frames=deblur.frames,
        device=devices.chosen(deblur.device, deblur.method),
    )


def _camera_of(request: Request, take: Take) -> tuple[sidecar.Camera, tuple[str, ...]]:
    """The camera, by the request, its profile or the file, whichever states it first; and what to know of how it was found."""
    rows, cols, profile, notes = take.shutter.rows, take.shutter.cols, take.profile, ()
    longer = max(rows, cols)
    shift = request.motion.model == "shift" and request.motion.trajectory is None
    if request.camera.focal_px is not None:
        focal, source = request.camera.focal_px, "explicit"
        if focal < _WIDEST * longer:
            raise ValueError(
                f"focal-px must be at least {_WIDEST * longer:g} px for a picture whose longer side is {longer} px, got {focal:g};"
                " is it in millimetres? pixels = millimetres * width of the picture in pixels / width of the sensor in millimetres"
            )
        if profile and profile.intrinsics and profile.intrinsics.distortion:
            notes = (f"the distortion of {profile.profile} is not used, since --focal-px states another lens; leave it out",)
    elif profile and profile.intrinsics:
        return sidecar.Camera.of(profile.intrinsics, profile.profile, profile.noise), ()
    elif take.focal is not None:
        focal, source, notes = take.focal.value, take.focal.source, take.focal_notes
        if take.focal.assumed:
            notes += (f"focal length {focal:.0f} px is {source}: roll depends on it; --focal-px states it",)
    elif shift or not request.deblur.method.needs_lens:
        focal, source = float(longer), "assumed"  # a shift does not depend on it
    elif take.of_clip:
        focal, source = usual.FOCAL * longer, "assumed"
        notes = (f"focal length {focal:.0f} px is assumed, {usual.FOCAL:g} of the longer side: roll depends on it; --focal-px states it",)
    else:
        raise ValueError(
            f"focal-px must be given, {request.source} does not say its focal length, as EXIF's 35 mm equivalent does;"
            " it is about 0.7 to 0.9 times the longer side for most phones, focal length / sensor's width * columns for cameras;"
            " --motion shift does without"
        )
    noise = profile.noise if profile else None
    return sidecar.Camera.of(Intrinsics.centred(focal=focal, rows=rows, cols=cols), source, noise), notes


def _gyro(request: Request, opened: Opened, frames: tuple[int, int], camera: physics.Camera, settings: Settings) -> Gyro | None:
    """The gyroscope's log that the method follows, laid along the frames [first, last)."""
    motion = request.motion
    if not request.deblur.method.follows_gyro or motion.trajectory is not None:
        return None
    if isinstance(opened.source, Still):
        if motion.gyro is None:
            raise ValueError(f"the method {request.deblur.method} needs a gyroscope's log of a photograph; give --gyro")
        return gyro_alignment.of_photograph(motion, request.source, camera.timing)
    from rsvideo.pipeline import clip_frames

    stream, (first, last) = opened.source, frames
    found = gyro_alignment.read(motion, request.source, camera.timing)
    shown = clip_frames.decoded(stream, first, min(last, first + gyro_alignment.LOOKED_AT), on_damage=request.input.on_damage)
    placed = gyro_alignment.placed(motion, found, shown, camera, settings)
    placed.check_cover((stream.times[first:last] - stream.times[0]) * float(stream.time_base), camera.timing)
    return placed
