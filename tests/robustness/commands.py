"""Absurd requests: options and their combinations, names, and inputs that are no files: `case(number)` gives the same every time."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.robustness import media, pictures
from tests.robustness.absurd import ABSURD, OF_CLIPS, RATES
from tests.robustness.case import Build, Case, Fault, rng

ROOM = "commands"
_SOUND = {
    "--exposure": "1/50",
    "--readout": "10ms",
    "--focal-px": "70",
    "--degree": "3",
    "--prior": "tv",
    "--direction": "bottom-to-top",
    "--transfer": "bt709",
    "--threads": "1",
}
_PLAYLIST = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nin.mp4\n#EXT-X-ENDLIST\n"
_CONCAT = "ffconcat version 1.0\nfile in.mp4\n"


def link(target: str) -> Build:
    """A link to something."""
    return lambda path: path.symlink_to(target)


def folder(path: Path) -> None:
    """An empty folder."""
    path.mkdir()


def pipe(path: Path) -> None:
    """A pipe that nobody writes into."""
    os.mkfifo(path)


def listening(path: Path) -> None:
    """A socket's file."""
    server = socket.socket(socket.AF_UNIX)
    here = Path.cwd()
    try:
        os.chdir(path.parent)  # the name of a socket may have 107 bytes
        server.bind(path.name)
    finally:
        os.chdir(here)
        server.close()


def _sources() -> dict[str, bytes | Build]:
    return {"in.png": pictures.whole("png"), "in.mp4": media.whole(0)}


def _traps() -> dict[str, bytes | Build]:
    return {**_sources(), "loop": link("loop"), "pipe": pipe, "loop.yaml": link("loop.yaml"), "pipe.yaml": pipe}


def _options(chance: np.random.Generator) -> dict:
    """One absurd option, among sound ones."""
    clip = chance.random() < 0.5
    offered = {**ABSURD, **OF_CLIPS} if clip else ABSURD
    name = str(chance.choice(list(offered)))
    values, fault = offered[name]
    sound = {
        key: value
        for key, value in _SOUND.items()
        if key != name and (key in ("--exposure", "--readout", "--focal-px") or chance.random() < 0.4)
    }
    if name == "--row-time":
        sound.pop("--readout")
    if name == "--shutter-angle":
        sound.pop("--exposure")
    if name == "--scanlines-total":
        sound.pop("--readout")
    if name.startswith("--gyro"):
        sound["--method"] = "gyro"
    words = [part for pair in sound.items() for part in pair]
    source, output = ("in.mp4", "out.mkv") if clip else ("in.png", "out.png")
    at = 2 * int(chance.integers(len(sound) + 1))
    words[at:at] = [name, str(values[int(chance.integers(len(values)))])]
    return {"words": ("deblur", source, "-o", output, *words), "fault": fault, "files": _traps(), "required": True}


def _contradictions(chance: np.random.Generator) -> dict:
    """Options that are sound alone, but not together; and words where none, or others, belong."""
    none = ("--method", "none")
    lines: tuple[tuple[str, ...], ...] = (
        ("deblur", "in.png", "-o", "out.png", "--exposure", "1/50", "--readout", "10ms", "--row-time", "1us"),
        ("deblur", "in.png", "-o", "out.png", "--range", "0-1", *none),
        ("deblur", "in.png", "-o", "out.png", "--method", "rectify"),
        ("deblur", "in.png", "-o", "in.png", "--overwrite", *none),
        ("deblur", "in.mp4", "-o", "in.mp4", "--overwrite", *none),
        ("deblur", "in.mp4", "-o", "./in.mp4", "--overwrite", *none),
        ("deblur", "in.mp4", "-o", "out.mkv", "--gyro", "in.mp4", *none),
        ("deblur", "in.mp4", "-o", "out.mkv", "--exposure", "1/50", "--shutter-angle", "180", "--readout", "1ms"),
        ("deblur", "in.mp4", "-o", "out.mkv", "--codec", "prores", "--pixel-format", "gray", *none),
        ("deblur", "in.mp4", "-o", "out.mp4", "--codec", "png", *none),
        ("deblur", "in.mp4", "-o", "out.png", *none),
        ("deblur", "in.png", "-o", "out.mp4", *none),
        ("deblur", "in.png", "-o", "out", *none),
        ("deblur", "in.png", "-o", "", *none),
        ("deblur", "in.png", "-o", ".", *none),
        ("deblur", "in.png", "-o", "nowhere/out.png", *none),
        ("deblur", "in.png", "-o", "in.mp4/out.png", *none),
        ("deblur", "in.png", "-o", "/proc/out.png", *none),
        ("deblur", "in.png", "-o", "pipe/out.png", *none),
        ("deblur", "in.png", "-o"),
        ("deblur", "in.png"),
        ("deblur",),
        ("deblur", "in.png", "in.mp4", "-o", "out.png"),
        ("deblur", "--", "-o", "out.png"),
        ("frobnicate", "in.png"),
        ("", "in.png"),
        ("--overwrite",),
        ("deblur", "in.png", "-o", "out.png", "--no-such-option"),
        ("deblur", "in.png", "-o", "out.png", "--exposure=1/50=2"),
        ("run", "job.yaml", "-j", "0"),
        ("run", "job.yaml", "-j", "257"),
        ("run", "job.yaml", "--set", "x"),
        ("run", "job.yaml", "--set", "camera.exposure=" + "9" * 5000),
        ("run", "job.yaml", "--set", "output.folder="),
        ("run", "job.yaml", "--set", "output.name=../../x"),
        ("run", "job.yaml", "--set", "output.name={nobody}"),
        ("run", "job.yaml", "--set", "output.folder=/proc/x", "--overwrite"),
        ("run", "job.yaml", "--set", "camera.x.y=1"),
        ("validate", "job.yaml", "--set", "=1"),
        ("plot", "in.png", "-o", "fig.bmp"),
        ("plot", "in.png", "-o", "nowhere/fig.png"),
        ("inspect", "in.mp4", "--rate", "0"),
        ("inspect", "in.mp4", "--camera", "x" * 5000),
        ("simulate", "-o", "nowhere/x"),
        ("calibrate",),
        ("calibrate", "convert", "nobody", "-o", "x.yaml"),
        ("compare", "in.mp4"),
        ("compare", "in.mp4", "-o", "in.mp4/x"),
    )
    job = b"defaults: {camera: {exposure: 1/50, readout: 10ms, focal_px: 70}, deblur: {method: none}}\nclips: [in.png, in.mp4]\n"
    words = lines[chance.integers(len(lines))]
    return {"words": words, "fault": Fault.OPTION, "files": {**_traps(), "job.yaml": job}, "required": True}


def _rates(chance: np.random.Generator) -> dict:
    """Rates of a folder of pictures."""
    take = {f"take/a_{n}.png": pictures.whole("png") for n in range(3)}
    rate = RATES[chance.integers(len(RATES))]
    words = ("deblur", "take", "-o", "out.mkv", "--codec", "ffv1", "--method", "none", "--rate", rate)
    return {"words": words, "fault": Fault.OPTION, "files": take, "required": True}


_ODD = (
    *(
        "two\nlines{}",
        "\x1b[31mred{}",
        "\x07bell{}",
        "back\rwards{}",
        "tab\t{}",
        "\u202egnp{}",
        " {}",
        ". {}",
        "..{}",
        "-o{}",
        "--help{}",
        "-{}",
    ),
    *(
        "a;rm -rf x{}",
        "$(touch x){}",
        "`x`{}",
        "a'b\"c{}",
        "%s%n{}",
        "a%04d{}",
        "a#{}",
        "a*{}",
        "[a]{}",
        "{{stem}}{}",
        "{}".ljust(3),
        "~{}",
        "\udcff\udcfe{}",
    ),
    *(
        "x" * 250 + "{}",
        "é" * 120 + "{}",
        "👩‍👩‍👧{}",
        "nul{}",
        "con{}",
        "a" * 240 + "{}",
        "concat:in{}",
        "file:in{}",
        "http:in{}",
        "pipe:0{}",
        "@in{}",
        "subfile,,start,0,end,0,,:{}",
    ),
)


def _names(chance: np.random.Generator) -> dict:
    """An input or an output with an odd name that can be: it must be restored; or refused as a name, where it is a pattern."""
    clip = chance.random() < 0.4
    suffix = ".mp4" if clip else ".png"
    name = _ODD[chance.integers(len(_ODD))].format(suffix).strip("\0")
    held, many = media.whole(0) if clip else pictures.whole("png"), ("#", "*", "%0")
    after = ("--method", "none", "-o", "out.mkv" if clip else "out.png")
    if chance.random() < 0.5:
        files, words, source, output = {name: held}, ("deblur", *after, "--", name), name, after[-1]
    else:
        output = name.replace(".mp4", ".mkv") if clip else name
        files, source = {f"in{suffix}": held}, f"in{suffix}"
        words = ("deblur", *after[:2], "-o" + output, "--", source)
    too_long = len(os.fsencode(name)) > 240
    wild = any(mark in name for mark in many) or Path(name).suffix != suffix
    fault = Fault.NAME if too_long or wild or "\udcff" in name else Fault.NONE
    if len(os.fsencode(name)) > 255:
        files, fault = _sources(), Fault.NAME
    return {"words": words, "fault": fault, "files": files, "source": source, "output": output if fault is Fault.NONE else None}


def _no_files(chance: np.random.Generator) -> dict:
    """Inputs that are no files, or that tell the reader to open others."""
    suffix = str(chance.choice([".mp4", ".mov", ".mkv", ".m3u8", ".ffconcat", ".avi", ".png", ".jpg", ".tif", ".dng", ".sdp", ""]))
    name = f"x{suffix}"
    laid: tuple[tuple[str, dict[str, bytes | Build]], ...] = (
        (name, {name: _PLAYLIST.encode()}),
        (name, {name: _CONCAT.encode()}),
        (name, {name: b"v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\n"}),
        (name, {name: link(name)}),
        (name, {name: link("other"), "other": link(name)}),
        (name, {name: link("absent")}),
        (name, {name: pipe}),
        (name, {name: listening}),
        (name, {name: folder}),
        (name, {name: link("/dev/zero")}),
        (name, {name: link("/dev/null")}),
        (name, {name: link("/proc/self/mem")}),
        (name, {name: link("/")}),
        (name, {name: b""}),
        (f"concat:in.mp4|in.mp4{suffix}", {}),
        (f"http://127.0.0.1:9/{name}", {}),
        (f"file:in{suffix}", {}),
        (f"file:///etc/passwd{suffix}", {}),
        (f"data:video/mp4;base64,AAAA{suffix}", {}),
        (f"crypto:in{suffix}", {}),
        (f"pipe:0{suffix}", {}),
        (f"async:in{suffix}", {}),
        ("/dev/zero", {}),
        ("/dev/stdin", {}),
        ("/dev/fd/0", {}),
        ("-", {}),
        ("/proc/self/environ", {}),
        ("\n", {}),
        ("a" * 5000, {}),
        ("/".join(["a" * 200] * 40), {}),
        ("../" * 3000, {}),
        ("take/a_####.png", {"take/a_1.png": pipe, "take/a_2.png": link("a_2.png")}),
        ("take", {"take/a_1.png": link("/dev/zero"), "take/a_2.png": pictures.whole("png")}),
        ("take", {"take/a_1.png": link("a_1.png")}),
        ("take", {f"take/a_{n}.png": pipe for n in range(3)}),
        ("take", {"take/take": link("..")}),
        ("**/*.png", {"a/b": link(".."), "b": link(".")}),
        ("/**", {}),
    )
    source, files = laid[int(chance.integers(len(laid)))]
    clip = Path(source).suffix in (".mp4", ".mov", ".mkv", ".avi") or source.startswith("take")
    words = (
        "deblur",
        "--method",
        "none",
        "-o",
        "out.mkv" if clip else "out.png",
        *(("--rate", "24") if source.startswith("take") else ()),
        "--",
        source,
    )
    words = ("inspect", "--", source) if chance.random() < 0.2 else words
    return {"words": words, "fault": Fault.NAME, "files": {**_sources(), **files}, "required": True}


def _in_jobs(chance: np.random.Generator) -> dict:
    """Jobs whose sources and names are hostile."""
    lines: tuple[str, ...] = (
        "clips: ['/**']",
        "clips: ['**/**/**/*.png']",
        "clips: ['loop/**/*.png']",
        "clips: [pipe]",
        "clips: [loop]",
        "clips: ['concat:in.mp4|in.mp4']",
        "clips: ['http://127.0.0.1:9/x.mp4']",
        "clips: [/dev/zero]",
        "clips: ['']",
        'clips: ["a\\nb.png"]',
        'clips: ["\\e[31m.mp4"]',
        "clips: ['../../../../../../etc/*']",
        "clips: [in.png, in.png]",
        "clips: [{source: in.png, name: in.png}]\noutput: {folder: .}",
        "clips: [in.png]\noutput: {folder: in.mp4}",
        "clips: [in.png]\noutput: {folder: pipe}",
        "clips: [in.png]\noutput: {folder: loop}",
        "clips: [in.png]\noutput: {folder: " + "x" * 300 + "}",
        "clips: [in.png]\noutput: {folder: /proc/x}",
        "clips: [in.png]\noutput: {name: '../{stem}'}",
        "clips: [in.png]\noutput: {name: '{stem}" + "x" * 300 + "{ext}'}",
        'clips: [in.png]\noutput: {name: "{stem}\\0{ext}"}',
        'clips: [in.png]\noutput: {folder: "a\\0b"}',
        'clips: ["a\\0b.png"]',
        "clips: [" + ", ".join(["in.png"] * 10_001) + "]",
        "clips: [{source: [in.mp4, in.png], range: 0-1}]",
        "clips: [{source: in.mp4, preset: nobody}]",
        "clips: [{source: in.mp4, camera: {profile: loop.yaml}}]",
        "clips: [{source: in.mp4, camera: {profile: pipe.yaml}}]",
        "clips: [{source: in.mp4, motion: {trajectory: /dev/zero}}]",
        "clips: [{source: in.mp4, deblur: {method: gyro}, motion: {gyro: pipe}}]",
        "clips: [absent.mp4]",
        "clips: ['[', '[a', '*[']",
    )
    text = lines[chance.integers(len(lines))] + "\ndefaults: {camera: {exposure: 1/50, readout: 10ms, focal_px: 70}}\n"
    files = {**_traps(), "job.yaml": text.encode(), "absent-folder": link("/")}
    words = ("validate", "job.yaml") if chance.random() < 0.3 else ("run", "job.yaml", "--dry-run")
    return {"words": words, "fault": Fault.SETTINGS, "files": files}


def _present(chance: np.random.Generator) -> dict:
    """Things that stand where results would go, or beside."""
    clip = chance.random() < 0.5
    source, output = ("in.mp4", "out.mkv") if clip else ("in.png", "out.png")
    stands: tuple[tuple[str, dict[str, bytes | Build], Fault], ...] = (
        ("a file", {output: b"mine"}, Fault.PRESENT),
        ("its sidecar", {"out.rsvideo.json": b"mine"}, Fault.PRESENT),
        ("a link to a file", {output: link("mine"), "mine": b"mine"}, Fault.PRESENT),
        ("a part", {f"{output}.part": b"mine"}, Fault.NONE),
        ("a part that is a link", {f"{output}.part": link("mine"), "mine": b"mine"}, Fault.NONE),
        ("a part that is a folder", {f"{output}.part/mine": b"mine"}, Fault.NONE),
        ("a part of the sidecar", {"out.rsvideo.json.part": link("mine"), "mine": b"mine"}, Fault.NONE),
    )
    _what, files, fault = stands[chance.integers(len(stands))]
    words = ("deblur", source, "-o", output, "--method", "none")
    more = {"fault": fault, "required": True} if fault is Fault.PRESENT else {"fault": Fault.PRESENT, "output": output}
    return {"words": words, "files": {**_sources(), **files}, **more}


_KINDS: tuple[tuple[str, Callable[[np.random.Generator], dict]], ...] = (
    ("absurd options", _options),
    ("no files", _no_files),
    ("absurd options", _options),
    ("contradictions", _contradictions),
    ("odd names", _names),
    ("absurd options", _options),
    ("hostile jobs", _in_jobs),
    ("no files", _no_files),
    ("what stands there", _present),
    ("absurd options", _options),
    ("odd names", _names),
    ("rates", _rates),
)


def case(number: int) -> Case:
    """One absurd request."""
    family, made = _KINDS[number % len(_KINDS)]
    return Case(**{"name": f"{ROOM}/{number}", "family": f"requests: {family}", **made(rng(ROOM, number))})
