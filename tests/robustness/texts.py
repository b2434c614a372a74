"""Damaged and absurd jobs, profiles, sidecars, motions and gyroscopes' logs: `case(number)` gives the same attack every time."""

import functools
import json
import re
from collections.abc import Callable

import numpy as np

from rsvideo.shooting.gcsv import FIRST_LINES
from tests.robustness import media, pictures
from tests.robustness.case import Case, Fault, rng

ROOM = "texts"
_NUMBER = re.compile(r"(?<![\w.])-?\d+(\.\d*)?([eE][-+]?\d+)?(?![\w.])")
_NUMBERS = (
    *(
        "0",
        "-1",
        "1e308",
        "-1e308",
        "1e999",
        "-1e999",
        "nan",
        "inf",
        "-0.0",
        "1e-320",
        "9" * 400,
        "0x10",
        "1_000",
        "1e99999999",
        "2147483648",
    ),
    *(
        "18446744073709551616",
        "1/0",
        "1/50",
        "''",
        "null",
        "true",
        "[]",
        "{}",
        "[1, 2]",
        '"word"',
        "1e5",
        "0.5",
        "-5e-324",
        "1e15",
        "1e300",
    ),
)
_BYTES = (
    b"\0",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\r",
    b"\n",
    b"\t",
    b"'",
    b'"',
    b"{",
    b"[",
    b":",
    b"&a ",
    b"*a",
    b"!!python/object/apply:os.system ",
    b"\x1b[31m",
    b"- ",
    b",",
    b"\xf0\x9f\x98\x80",
)
_TIME = ("--exposure", "1/50", "--readout", "10ms")

_JOB = """output:
  folder: results
  name: "{stem}_sharp{ext}"
report:
  most_failed_frames: 0
defaults:
  camera:
    exposure: 1/50
    readout: 10ms
    focal_px: 70
  deblur:
    method: none
presets:
  wide:
    camera: { readout: 16.1ms, focal_px: 90 }
clips:
  - in.png
  - source: [in.mp4]
    preset: wide
    input: { range: 00:00-00:01 }
    encoding: { codec: ffv1 }
    name: "{stem}_b.mkv"
"""
_GYROFLOW = {
    "name": "A lens",
    "camera_brand": "B",
    "camera_model": "C",
    "calib_dimension": {"w": 64, "h": 48},
    "orig_dimension": {"w": 64, "h": 48},
    "fps": 24.0,
    "frame_readout_time": 16.0,
    "fisheye_params": {
        "RMS_error": 0.5,
        "camera_matrix": [[70, 0, 32], [0, 70, 24], [0, 0, 1]],
        "distortion_coeffs": [0.01, 0.0, 0.0, 0.0],
    },
    "distortion_model": "opencv_fisheye",
}
_KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [70.0, 70.0, 32.0, 24.0]
  distortion_model: radtan
  distortion_coeffs: [0.01, 0.0, 0.0, 0.0]
  resolution: [64, 48]
  line_delay: 0.0002
"""
_OPENCV = """%YAML:1.0
---
image_width: 64
image_height: 48
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 70., 0., 32., 0., 70., 24., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.01, 0., 0., 0., 0. ]
"""
_OURS = """name: T
maker: M
source: a measurement
mode: {rows: 48, cols: 64, fps: 24}
timing:
  readout_s:
    value: 0.0087
    std: 0.0001
    how: flicker
    source: a measurement
"""


@functools.cache
def _sidecar() -> str:
    """A sidecar of one photograph of 64 x 48."""
    t = np.linspace(0, 0.03, 64)
    frame = {
        "index": 0,
        "time_s": 0.0,
        "timing": {"exposure_s": 0.02, "row_time_s": 0.01 / 48, "source": "explicit"},
        "trajectory": {"t_s": t.tolist(), "x_px": (50 * t).tolist(), "y_px": (-30 * t).tolist(), "roll_rad": (0.1 * t).tolist()},
        "verdict": "restored",
        "seconds": 0.5,
        "convergence": [3.0, 2.0, 1.5],
    }
    camera = {"fx": 70.0, "fy": 70.0, "cx": 31.5, "cy": 23.5, "rows": 48, "cols": 64, "source": "explicit"}
    settings = {
        "rsvideo": "0.1.0",
        "camera": camera,
        "direction": "top-to-bottom",
        "transfer": "srgb",
        "trajectory_from": None,
        "restoration": {"degree": 4},
    }
    head = f'{{"version":1,"input":"in.png","settings":{json.dumps(settings, separators=(",", ":"))},"frames":['
    return head + "\n" + json.dumps(frame, separators=(",", ":")) + "\n]}\n"


def _motion() -> str:
    t = np.linspace(-0.01, 0.05, 61)
    return "t_s,pitch_rad,yaw_rad,roll_rad\n" + "".join(f"{a:.6f},{0.01 * np.sin(30 * a):.8f},{0.02 * a:.8f},0\n" for a in t)


def _gcsv() -> str:
    head = f"{FIRST_LINES[0]}\nversion,1.3\nid,x\norientation,yxz\ntscale,0.001\ngscale,0.001\nascale,1\nt,gx,gy,gz\n"
    return head + "".join(f"{n},{int(300 * np.sin(n / 9))},{int(200 * np.cos(n / 7))},5\n" for n in range(400))


def _phone_log() -> str:
    return "".join(f"{n * 1_000_000} {0.3 * np.sin(n / 9):.5f} {0.2 * np.cos(n / 7):.5f} 0.001\n" for n in range(400))


def _letters(text: str, chance: np.random.Generator) -> bytes:
    """Bytes changed, put in, or taken out."""
    made = bytearray(text.encode())
    for _ in range(int(chance.integers(1, 8))):
        at = int(chance.integers(len(made)))
        match int(chance.integers(4)):
            case 0:
                made[at] = int(chance.integers(256))
            case 1:
                made[at:at] = _BYTES[chance.integers(len(_BYTES))]
            case 2:
                del made[at : at + int(chance.integers(1, 20))]
            case _:
                made[at] ^= 1 << int(chance.integers(8))
    return bytes(made)


def _numbers(text: str, chance: np.random.Generator) -> bytes:
    """Some of the numbers replaced by absurd ones."""
    words, at = [], 0
    places = [(match.start(), match.end()) for match in _NUMBER.finditer(text)]
    chosen = {int(n) for n in chance.integers(0, len(places), int(chance.integers(1, 3)))}
    for number, (start, end) in enumerate(places):
        words.append(text[at:start] + (str(chance.choice(_NUMBERS)) if number in chosen else text[start:end]))
        at = end
    return ("".join(words) + text[at:]).encode()


def _lines(text: str, chance: np.random.Generator) -> bytes:
    """Lines missing, twice, in another order, indented otherwise; or cut short."""
    lines = text.splitlines(keepends=True)
    for _ in range(int(chance.integers(1, 4))):
        one, two = (int(n) for n in chance.integers(0, len(lines), 2))
        match int(chance.integers(5)):
            case 0 if len(lines) > 1:
                del lines[one]
            case 1:
                lines[one:one] = [lines[two]] * int(chance.choice((1, 2, 200)))
            case 2:
                lines[one], lines[two] = lines[two], lines[one]
            case 3:
                lines[one] = " " * int(chance.integers(1, 9)) + lines[one]
            case _:
                lines[one] = lines[one][: int(chance.integers(len(lines[one]) + 1))]
    made = "".join(lines)
    return made.encode() if chance.random() < 0.8 else made.encode()[: int(chance.integers(1, len(made) + 1))]


def _large(text: str, chance: np.random.Generator) -> bytes:
    """Much of something: deep nesting, long lines, many keys, many references to one thing, other encodings."""
    many = int(chance.choice((100, 5_000, 90_000)))
    match int(chance.integers(8)):
        case 0:
            return b"[" * many + b"]" * many
        case 1:
            return b"{a: " * many
        case 2:
            return b'{"version":1,"frames":[' + b"0," * many + b"0]}"
        case 3:
            bomb = ["a0: &a0 [x, x, x]", *(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12))]
            return "\n".join([*bomb, text]).encode()
        case 4:
            return text.encode("utf-16")
        case 5:
            return text.encode() + b"x" * many
        case 6:
            return ("".join(f"k{n}: 1\n" for n in range(many // 10)) + text).encode()
        case _:
            return b"- " * many + b"x"


_DAMAGE: tuple[Callable[[str, np.random.Generator], bytes], ...] = (_numbers, _letters, _numbers, _lines, _numbers, _large)


def _job(data: bytes, chance: np.random.Generator) -> dict:
    run = [("validate", "job.yaml"), ("run", "job.yaml", "--dry-run"), ("run", "job.yaml", "--progress", "none")]
    words = run[chance.choice(3, p=(0.6, 0.3, 0.1))]
    return {"words": words, "fault": Fault.SETTINGS, "files": {"job.yaml": data, **_sources()}}


def _profile(suffix: str) -> Callable[[bytes, np.random.Generator], dict]:
    def words(data: bytes, chance: np.random.Generator) -> dict:
        name = f"camera{suffix}"
        commands = (
            ("inspect", "in.mp4", "--camera", name),
            ("calibrate", "show", name, "-o", "page.png"),
            ("calibrate", "convert", name, "-o", "other.yaml"),
        )
        command = commands[chance.choice(3, p=(0.7, 0.15, 0.15))]
        return {"words": command, "fault": Fault.SETTINGS, "files": {name: data, **_sources()}}

    return words


def _plotted(data: bytes, _: np.random.Generator) -> dict:
    return {"words": ("plot", "a.rsvideo.json", "-o", "fig.png"), "files": {"a.rsvideo.json": data}, "output": "fig.png"}


def _followed(name: str, option: str, *more: str) -> Callable[[bytes, np.random.Generator], dict]:
    def words(data: bytes, _: np.random.Generator) -> dict:
        command = ("deblur", "in.png", "-o", "out.png", *_TIME, "--focal-px", "70", "--prior", "tv", option, name, *more)
        return {"words": command, "fault": Fault.MOTION, "files": {name: data, "in.png": pictures.whole("png")}, "output": "out.png"}

    return words


def _sources() -> dict[str, bytes]:
    return {"in.png": pictures.whole("png"), "in.mp4": media.whole(0)}


_ATTACKED: tuple[tuple[str, Callable[[], str], Callable[[bytes, np.random.Generator], dict]], ...] = (
    ("jobs", lambda: _JOB, _job),
    ("sidecars", _sidecar, _plotted),
    ("profiles", lambda: _OURS, _profile(".yaml")),
    ("jobs", lambda: _JOB, _job),
    ("motions", _motion, _followed("motion.csv", "--trajectory")),
    ("profiles", lambda: json.dumps(_GYROFLOW), _profile(".json")),
    ("sidecars", _sidecar, _followed("a.rsvideo.json", "--trajectory")),
    ("gyroscopes' logs", _gcsv, _followed("log.gcsv", "--gyro", "--method", "gyro", "--gyro-offset", "0.1")),
    ("profiles", lambda: _KALIBR, _profile(".yaml")),
    ("gyroscopes' logs", _phone_log, _followed("log.txt", "--gyro", "--method", "gyro", "--gyro-offset", "0.1", "--gyro-axes", "XYZ")),
    ("profiles", lambda: _OPENCV, _profile(".yaml")),
)


def case(number: int) -> Case:
    """One attack on the readers of text."""
    chance = rng(ROOM, number)
    family, sound, words = _ATTACKED[number % len(_ATTACKED)]
    damage = _DAMAGE[(number // len(_ATTACKED)) % len(_DAMAGE)]
    how = words(damage(sound(), chance), chance)
    return Case(**{"name": f"{ROOM}/{number}", "family": family, "fault": Fault.SOURCE, **how})
