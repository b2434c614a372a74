"""Removes motion blur and rolling-shutter distortion together, from ordinary hand-held footage.

    import rsvideo

    photograph = rsvideo.read("blurred.jpg")
    result = rsvideo.deblur(photograph, shutter=rsvideo.Shutter(exposure="1/50", readout="20ms"), camera=rsvideo.Camera(focal_px=1400))
    rsvideo.write("sharp.png", result.latent, like=photograph)

`deblur` takes one photograph, `deblur_clip` a clip, as arrays or a file; `track` finds motion alone; `simulate` renders pictures and
their truth; `read`, `read_clip` and `write` are for files. Each name is loaded when it is first used.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsvideo.api.camera import Camera
    from rsvideo.api.clip import Track, deblur_clip, track
    from rsvideo.api.deblur import deblur
    from rsvideo.api.files import Clip, Picture, read, read_clip, write
    from rsvideo.api.result import Result
    from rsvideo.api.settings import Settings
    from rsvideo.api.shutter import Shutter
    from rsvideo.api.simulate import Simulated, simulate
    from rsvideo.api.trajectory import Trajectory
    from rsvideo.config.files import UnreadableError
    from rsvideo.frame import Verdict
    from rsvideo.progress import Progress

    __version__: str

__all__ = [
    "Camera",
    "Clip",
    "Picture",
    "Progress",
    "Result",
    "Settings",
    "Shutter",
    "Simulated",
    "Track",
    "Trajectory",
    "UnreadableError",
    "Verdict",
    "__version__",
    "deblur",
    "deblur_clip",
    "read",
    "read_clip",
    "simulate",
    "track",
    "write",
]

_HOMES = {  # the module of each name
    "Camera": "rsvideo.api.camera",
    "Clip": "rsvideo.api.files",
    "Picture": "rsvideo.api.files",
    "Progress": "rsvideo.progress",
    "Result": "rsvideo.api.result",
    "Settings": "rsvideo.api.settings",
    "Shutter": "rsvideo.api.shutter",
    "Simulated": "rsvideo.api.simulate",
    "Track": "rsvideo.api.clip",
    "Trajectory": "rsvideo.api.trajectory",
    "UnreadableError": "rsvideo.config.files",
    "Verdict": "rsvideo.frame",
    "deblur": "rsvideo.api.deblur",
    "deblur_clip": "rsvideo.api.clip",
    "read": "rsvideo.api.files",
    "read_clip": "rsvideo.api.files",
    "simulate": "rsvideo.api.simulate",
    "track": "rsvideo.api.clip",
    "write": "rsvideo.api.files",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("rsvideo")
    if name not in _HOMES:
        raise AttributeError(f"module 'rsvideo' has no attribute {name!r}")
    from importlib import import_module

    value = globals()[name] = getattr(import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
