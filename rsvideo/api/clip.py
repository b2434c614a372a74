"""Clips, from arrays or a file to arrays: restored, or only tracked."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from os import PathLike, fspath
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from rsvideo.api import footage as sources
from rsvideo.api.camera import Camera
from rsvideo.api.files import Clip
from rsvideo.api.footage import Footage
from rsvideo.api.result import Result, public, within
from rsvideo.api.settings import Settings
from rsvideo.api.shutter import Shutter
from rsvideo.api.trajectory import Trajectory
from rsvideo.api.treatment import Stated
from rsvideo.config import sidecar
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline import chunk as chunks
from rsvideo.pipeline import overlaid
from rsvideo.pipeline.tracked import Tracked
from rsvideo.progress import Observer, ignore
from rsvideo.restoration.movement import Evidence, Movement
from rsvideo.video.stream import Picture

Source = Iterable[np.ndarray] | str | PathLike[str]  # a Clip is an iterable too


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """The motion of a clip's camera, as `track` finds it.

    Attributes:
        trajectories: Of each frame; None where no point of it could be followed.
        steps: (frames, 3) from the pose at the middle of each frame's interval to the next one's, x and y in px, roll in rad; 0 where
            `tied` is False.
        tied: (frames,) whether points lead to the next frame; False at cuts, and of the last.
        evidence: What points and blur tell of each frame beside its path; each is restored as far as they bear the path out. Without
            it, a motion is followed as it is.
        times: (frames,) seconds at which each frame's first row opens, counted from the first frame's.
        timing: The shutter of every frame, but for its exposure where that changes.
        exposures: (frames,) seconds.
        camera: The lens in pixels.
        noise: Of the sensor, where a profile gave it.
        notes: What the user should know: what was assumed, and from where.
    """

    trajectories: tuple[Trajectory | None, ...] = field(repr=False)
    steps: Float[np.ndarray, "frames 3"] = field(repr=False)
    tied: Bool[np.ndarray, " frames"] = field(repr=False)
    evidence: tuple[Evidence, ...] = field(repr=False, default=())
    times: Float[np.ndarray, " frames"] = field(repr=False)
    timing: ShutterTiming
    exposures: Float[np.ndarray, " frames"] = field(repr=False)
    camera: Intrinsics
    noise: Noise | None = None
    notes: tuple[str, ...] = ()


def deblur_clip(
    frames: Source,
    *,
    shutter: Shutter | None = None,
    camera: Camera | None = None,
    settings: Settings | None = None,
    rate: float | str | Fraction | None = None,
    transfer: str | None = None,
    trajectory: Track | str | PathLike[str] | None = None,
    force: bool = False,
    observe: Observer | None = None,
) -> Iterator[Result]:
    """Remove motion blur and rolling-shutter distortion from a clip, frame by frame; nothing is written.

    The clip is gone through once for its cuts and once, chunk by chunk, for its motion and its latent images, so that memory
    does not grow with its length (about 40 frames are held). An iterator that can be consumed only once is kept in a temporary file.
    The pixels are those that `rsvideo deblur` writes for the same frames without loss. As there, the clip's 40 middle frames show an
    exposure, a readout and a focal length that nobody states, and whether a stated exposure can be right, before this returns; what
    they do not show is assumed, as results' notes say. Nothing is measured along a motion that is given.

    Args:
        frames: A file, a folder of pictures, a `Clip`, or an iterable of arrays of one shape and kind, as `deblur` takes them.
        shutter: Exposure, readout and direction of every frame; what it leaves open a file's metadata, the profile and then the clip's
            own frames answer.
        camera: The focal length, or a profile; of a file also a camera of the public table of readout times.
        settings: How to restore; the command line's defaults unless given.
        rate: Frames a second, of arrays and of folders of pictures, such as 24 or "24000/1001".
        transfer: What codes mean, by name. [default: the clip's tag, or "srgb" of arrays]
        trajectory: Restore along this motion: a `Track` of the same clip, or a file (a sidecar of `rsvideo track` or `rsvideo deblur`, or
            CSV of t_s,pitch_rad,yaw_rad,roll_rad over the whole clip). Shutter and lens are those with which `track` or `rsvideo track`
            found it.
        force: Take exposure and readout as stated, whatever the clip's blur shows, and though they are longer than a frame's period.
        observe: Called with a `Progress` (stage, fraction of its frame, frame) now and then.

    Returns:
        An iterator of the frames' results in order; of a file, pictures are float32 linear light.

    Raises:
        ValueError, TypeError, UnreadableError: As `deblur`; what the first frame shows at once, the rest when it is reached.

    Examples:
        >>> import rsvideo
        >>> shutter, camera = rsvideo.Shutter(exposure="1/50", readout="20ms"), rsvideo.Camera(focal_px=400)
        >>> clip = rsvideo.read_clip("samples/clip/blurred.mp4")
        >>> strips = [frame[:, 96:288] for frame in clip][:3]  # fewer columns are quicker; fewer rows would have a shorter readout
        >>> for result in rsvideo.deblur_clip(strips, shutter=shutter, camera=camera, rate=clip.rate):
        ...     print(result.index, result.verdict.value, result.latent.shape)
        0 restored (216, 192, 3)
        1 restored (216, 192, 3)
        2 restored (216, 192, 3)
    """
    given = trajectory if isinstance(trajectory, Track) else None
    motion = None if trajectory is None or isinstance(trajectory, Track) else Path(trajectory)
    found = _tracked(given) if given else None
    stated = Stated.of(
        shutter, camera, settings, rate=rate, transfer=transfer, motion=motion, moved=trajectory is not None, found=found, force=force
    )
    shot = _footage(frames, stated)
    return _restored(shot, given, observe or ignore)


def track(
    frames: Source,
    *,
    shutter: Shutter | None = None,
    camera: Camera | None = None,
    settings: Settings | None = None,
    rate: float | str | Fraction | None = None,
    transfer: str | None = None,
    force: bool = False,
    observe: Observer | None = None,
) -> Track:
    """Find how the camera moved in and between the frames of a clip, and restore nothing.

    Args and errors are those of `deblur_clip`; the answer may be given to it as `trajectory`.

    Examples:
        >>> import rsvideo
        >>> shutter, camera = rsvideo.Shutter(exposure="1/50", readout="20ms"), rsvideo.Camera(focal_px=400)
        >>> clip = rsvideo.read_clip("samples/clip/blurred.mp4")
        >>> path = rsvideo.track([*clip][:4], shutter=shutter, camera=camera, rate=clip.rate)
        >>> len(path.trajectories), path.steps.shape, bool(path.tied[:-1].all())
        (4, (4, 3), True)
        >>> path.trajectories[0].poses.shape  # of the first frame's own motion
        (161, 3)
    """
    if settings is not None and settings.frames == "cold":
        raise ValueError("frames must be together or alone to track a clip, got 'cold', which restores each frame as a still")
    shot = _footage(frames, Stated.of(shutter, camera, settings, rate=rate, transfer=transfer, force=force))
    camera_found, found, times = shot.treatment.camera, [], []
    for chunk, pictures in shot.chunks():
        overlay = overlaid.found(shot.treatment, pictures, shot.colour)
        moving = chunks.movement(shot.treatment, pictures, shot.colour, overlay, None, observe or ignore)
        mine, part = chunks.own(chunk, pictures, moving)
        found.append(part)
        times += [picture.time for picture in mine]
    steps = np.vstack([part.steps for part in found])
    return Track(
        trajectories=tuple(curve and Trajectory(curve=curve) for part in found for curve in part.within),
        steps=np.pad(steps, ((0, 0), (0, 3 - steps.shape[1]))),
        tied=np.array([tied for part in found for tied in part.tied], bool),
        evidence=tuple(one for part in found for one in part.evidence),
        times=np.array(times, float),
        timing=camera_found.timing,
        exposures=np.array([each.timing.exposure for part in found for each in part.cameras(camera_found)]),
        camera=camera_found.intrinsics,
        noise=camera_found.noise,
        notes=shot.notes,
    )


def _tracked(path: Track) -> Tracked:
    """With which shutter and lens it was found."""
    lens = sidecar.Camera.of(path.camera, "trajectory", path.noise)
    return Tracked(path=Path("the given Track"), timing=path.timing, timing_source="trajectory", camera=lens)


def _footage(frames: Source, stated: Stated) -> Footage:
    if isinstance(frames, str | PathLike):
        return sources.of_path(Path(fspath(frames)), stated)
    if isinstance(frames, Clip):
        return sources.of_path(frames, stated)
    return sources.of_arrays(frames, stated)


def _restored(shot: Footage, given: Track | None, observe: Observer) -> Iterator[Result]:
    for chunk, pictures in shot.chunks():
        treatment, meaning = shot.treatment, shot.colour
        overlay = overlaid.found(treatment, pictures, meaning)
        moving = _given(given, pictures) if given else chunks.movement(treatment, pictures, meaning, overlay, shot.motion, observe)
        for picture, result, to_next in chunks.restored(treatment, chunk, pictures, meaning, overlay, moving, observe):
            latent = shot.shown(picture, within(result.latent) if result.verdict.changed else result.frame.pixels)
            yield public(result, latent, camera=shot.treatment.camera.intrinsics, to_next=to_next, notes=shot.notes)


def _given(track: Track, pictures: list[Picture]) -> Movement:
    first, last = pictures[0].index, pictures[-1].index + 1
    if last > len(track.times):
        raise ValueError(f"trajectory must be a track of the same clip, it holds {len(track.times)} frames and the clip more")
    within = [path and path.curve for path in track.trajectories[first:last]]
    axes = next((curve.coefficients.shape[1] for curve in within if curve), 3)
    steps, tied = track.steps[first:last, :axes], track.tied[first:last].tolist()
    exposures = track.exposures[first:last].tolist()
    return Movement(within=within, steps=steps, tied=tied, evidence=[*track.evidence[first:last]], exposures=exposures)
