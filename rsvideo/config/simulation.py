"""The request for a simulation: every option with its type, unit, bounds, default and words, once, as `request` has those of a job."""

from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from rsvideo.config import option, request
from rsvideo.config.option import Option, OptionField
from rsvideo.config.request import Section
from rsvideo.config.units import Pixels, Rate, Size, Time, TimeOrZero
from rsvideo.physics.noise import USUAL_NOISE
from rsvideo.physics.shutter import RENDERED, Direction

_PHOTOGRAPHS = ("camera.profile", "camera.focal_px", "motion", "frame")  # the sections and options that concern photographs only


class Camera(request.Camera):
    """The camera that takes the scene anew."""

    profile: Annotated[
        str | None,
        Option(
            help="A profile by name or file: focal length, distortion, noise and readout are its own. SHARP is taken to show what"
            " its lens shows, and the frame is its whole picture.",
            metavar="NAME",
            named="--camera",
            is_file=True,
        ),
    ] = None
    exposure: Annotated[Time | None, Option(help="How long each row collects light: 1/50, 20ms, 0.02; required.", metavar="TIME")] = None
    readout: Annotated[
        TimeOrZero | None,
        Option(help="Rows times row time; 0 is a global shutter.", metavar="TIME", unless="the profile's"),
    ] = None
    row_time: Annotated[
        TimeOrZero | None, Option(help="From one row's opening to the next one's, instead of --readout.", metavar="TIME")
    ] = None
    direction: Annotated[
        Direction | None,
        Option(help="In which direction the readout runs over the picture as stored.", unless="the profile's, or top-to-bottom"),
    ] = None
    focal_px: Annotated[Pixels | None, Option(help="Focal length in pixels of SHARP.", metavar="PX", unless="the profile's")] = None


class Motion(Section):
    """How the camera moves while it takes a photograph; one of three is given."""

    gyro: Annotated[Path | None, Option(help="Motion recorded as lines `t_ns wx wy wz` in rad/s.", metavar="LOG", is_file=True)] = None
    start: Annotated[float, Option(help="When the frame opens, in seconds from the first line of --gyro.", metavar="S")] = 0.0
    gyro_axes: Annotated[
        str,
        Option(help="The gyro's axes along the camera's right, down and forward; small letters turn them round.", metavar="XYZ"),
    ] = "XYZ"
    polynomial: Annotated[
        str | None,
        Option(
            help="`x:0,12,-4;y:0,5;roll:0,0.01` in px and rad, by powers of u = 0..1 through the frame; or a .yaml.",
            metavar="TEXT",
            is_file=True,
        ),
    ] = None
    shake: Annotated[bool, Option(help="A random hand-shake, by --seed.")] = False
    model: Annotated[Literal["rotation", "shift"], Option(help="All three angles, or no roll.", named="--motion")] = "rotation"
    blur_px: Annotated[float | None, Option(help="Scale the motion so that the longest streak of any row spans this.", metavar="PX")] = None


class Frame(Section):
    """How a photograph's frame is rendered and written."""

    size: Annotated[Size | None, Option(help="Of the frame.", metavar="COLSxROWS", unless="all that the motion leaves in view")] = None
    samples: Annotated[int, Field(ge=1, le=4096), Option(help="Time samples a row.")] = RENDERED
    gain: Annotated[float, Option(help="Multiplies the light, so that highlights clip.")] = 1.0
    transfer: Annotated[Literal["srgb", "bt709", "linear"] | None, Option(help="How codes stand for light.", unless="srgb")] = None
    bits: Annotated[Literal["8", "16"] | None, Option(help="A sample of OUT.", unless="as in SHARP")] = None
    truth: Annotated[Path | None, Option(help="The sharp frame.", metavar="FILE", unless="truth beside OUT, with OUT's ending")] = None


class Film(Section):
    """How a sharp clip is filmed anew."""

    last_exposure: Annotated[
        Time | None,
        Option(
            help="The last frame's exposure; from --exposure on it changes evenly, as automatic exposure does.",
            metavar="TIME",
            unless="--exposure",
            clips_only=True,
        ),
    ] = None
    speed: Annotated[float, Option(help="Its frames a frame, 1.5 or 3, for faster motion.", metavar="N", clips_only=True)] = 1.0
    rate: Annotated[Rate | None, Option(help="Frames a second, 30.", metavar="FPS", unless="CLIP's", clips_only=True)] = None
    first: Annotated[int, Option(help="Its first frame that is used.", metavar="N", clips_only=True)] = 0
    frames: Annotated[int | None, Option(help="How many are made.", metavar="N", unless="all, up to a cut", clips_only=True)] = None
    largest_side: Annotated[
        int | None, Option(help="Average a larger picture down to this.", metavar="PX", unless="CLIP's own", clips_only=True)
    ] = None


class Grain(Section):
    """What chance adds."""

    noise: Annotated[
        float | None,
        Option(
            help="Read and shot noise at half of white, in linear light; white is 1.",
            metavar="SIGMA",
            unless=f"the profile's, or {USUAL_NOISE:g}",
        ),
    ] = None
    seed: Annotated[int, Field(ge=0), Option(help="Of the hand-shake and of the noise.")] = 0


class Simulation(Section):
    """All options, in their sections."""

    camera: Camera = Camera()
    motion: Motion = Motion()
    frame: Frame = Frame()
    film: Film = Film()
    grain: Grain = Grain()

    def check_kind(self, *, of_clip: bool) -> None:
        """Refuse options that are not of the source's kind."""
        for each in option_fields():
            if getattr(getattr(self, each.section), each.name) == each.field.default:
                continue
            if of_clip and (each.section in _PHOTOGRAPHS or each.key in _PHOTOGRAPHS):
                raise ValueError(
                    f"{each.flag} must not be given with --from-clip: it is for a photograph, a clip has its own motion and size"
                )
            if not of_clip and each.option.clips_only:
                raise ValueError(f"{each.flag} must be given with --from-clip: a photograph has no frames to choose from")


@cache
def option_fields() -> tuple[OptionField, ...]:
    """All options of a simulation."""
    return tuple(option.fields(Simulation))
