"""rsvideo compare: several methods on one input, a job's clips or a folder of cases, and who wins."""

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer import Option

from rsvideo.cli import asked, options
from rsvideo.cli.validate import Sets, refusing
from rsvideo.config.method import GyroFile, Method

if TYPE_CHECKING:
    from rsvideo.comparison.method_run import Attempt
    from rsvideo.pipeline.clip_job import ClipJob
    from rsvideo.pipeline.job import Job
    from rsvideo.report.comparison import Comparison
    from rsvideo.report.table import Format

Show = Callable[[str, float], None]
_ALL = (
    Method.NONE,
    Method.RSVIDEO,
    Method.UNIFORM,
    Method.NONUNIFORM,
    Method.RECTIFY,
    Method.RECTIFY_UNIFORM,
    Method.RECTIFY_NONUNIFORM,
    Method.STITCH,
    Method.VIDSTAB,
    Method.VIDSTAB_UNIFORM,
    Method.GYRO,
    Method.GYRO_REFINE,
)
_TABLE = (Method.NONE, Method.UNIFORM, Method.NONUNIFORM, Method.STITCH, Method.RECTIFY_UNIFORM, Method.RSVIDEO)
_FORMATS: dict[str, "Format"] = {".md": "markdown", ".tex": "latex", ".csv": "csv"}


def compare(
    source: Annotated[Path | None, typer.Argument(metavar="INPUT|JOB.yaml", help="A photograph, a clip, or a job's file.")] = None,
    output: Annotated[Path | None, Option("-o", "--output", metavar="REPORT", help="A folder; with --table, a file.")] = None,
    methods: Annotated[
        str | None,
        Option(metavar="A,B,...", help=f"Of {', '.join(Method)}. [default: all that apply; those of --table: {', '.join(_TABLE)}]"),
    ] = None,
    truth: Annotated[Path | None, Option(metavar="FILE", help="What is shown when nothing blurs; then PSNR and SSIM are told.")] = None,
    crop: Annotated[list[str] | None, Option(metavar="X,Y,W,H", help="A part to look at first; more than one may be given.")] = None,
    table: Annotated[Path | None, Option(metavar="CASES", help="A folder of cases, with stills/NAME and clips/NAME: PSNR of each.")] = None,
    format_: Annotated[
        Literal["markdown", "latex", "csv"] | None, Option("--format", help="Of the table. [default: by -o's ending]")
    ] = None,
    results: Annotated[
        Path | None,
        Option(metavar="FOLDER", help="Where what the methods make is kept, and taken from. [default: results, in or beside -o]"),
    ] = None,
    jobs: Annotated[int, Option("-j", "--jobs", metavar="N", min=1, max=256, help="Methods at a time; times are fair with 1.")] = 1,
    resume: Annotated[bool, Option("--resume/--fresh", help="Take results of the same request that are there, or make them anew.")] = True,
    exposure: options.Exposure = None,
    shutter_angle: options.ShutterAngle = None,
    readout: options.Readout = None,
    row_time: options.RowTime = None,
    scanlines_total: options.ScanlinesTotal = None,
    direction: options.ReadoutDirection = None,
    focal_px: options.FocalPx = None,
    camera: options.Camera = None,
    motion: options.Motion = None,
    prior: options.Prior = None,
    frames: options.Frames = None,
    transfer: options.Transfer = None,
    trajectory: options.GivenMotion = None,
    block_rows: options.BlockRows = None,
    gyro: options.Gyro = None,
    gyro_offset: options.GyroOffset = None,
    gyro_axes: options.GyroAxes = None,
    part: options.Range = None,
    rate: options.Rate = None,
    codec: Annotated[Literal["same", "h264", "hevc", "prores", "dnxhr", "ffv1"] | None, Option(help="Of the clips that are kept.")] = None,
    quality: options.Quality = None,
    force: options.Force = False,
    sets: Sets = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace the report, or the table.")] = False,
    json: Annotated[bool, Option("--json", help="Print report.json on standard output.")] = False,
) -> int:
    """Try several methods, and show who wins and why: a page (index.html) to open, the same numbers in report.csv and report.json.

    Each method runs in a process of its own, so that its time and memory are its own; one that fails is shown with its reason.

    Exit codes: 0 all done; 1 a method failed; 2 the request is wrong; 3 an input is damaged or missing; 4 a report exists.
    """
    words = asked.words(locals())
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    with refusing():
        wanted = None if methods is None else _methods(methods)
        crops = [_crop(text) for text in crop or ()]
        if output is None:
            raise ValueError("-o must say where the report goes: a folder, or the file of the table")
        if (source is None) == (table is None):
            raise ValueError("one input must be given: a photograph, a clip or a job's file, or --table with a folder of cases")
        given = next((asked.option(name) for name in words), None)
        if table is not None:
            if given or truth or crops:
                raise ValueError(f"{given or ('--truth' if truth else '--crop')} cannot be given with --table: each case says it by itself")
            kind = format_ or _FORMATS.get(output.suffix.lower())
            if kind is None:
                raise ValueError(
                    f"{output} must end in {', '.join(_FORMATS)}, it ends in {output.suffix!r}; or --format says what it holds"
                )
            folder = results or output.with_name(output.stem + "_results")
            return _table(table, output, kind, wanted or _TABLE, folder, jobs=jobs, resume=resume, overwrite=overwrite)
        assert source is not None
        kept = results or output / "results"
        if source.suffix.lower() in (".yaml", ".yml"):
            if given:
                raise ValueError(f"{given} cannot be given with a job's file, which says it; --set camera.exposure=1/50 does")
            works, title = _of_job(source, wanted, truth, crops, kept, sets or ()), source.stem
        else:
            if sets:
                raise ValueError("--set is for a job's file")
            works, title = [_of_words(source, wanted, truth, crops, kept, words)], None
        return _compared(works, output, title, jobs=jobs, resume=resume, overwrite=overwrite, json=json)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Work:
    """One input, and what is tried on it."""

    name: str
    jobs: "Sequence[Job | ClipJob]"
    truth: Path | None
    crops: Sequence[tuple[int, int, int, int]]


def _methods(text: str) -> tuple[Method, ...]:
    from rsvideo.config.yaml import meant, shown

    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names:
        raise ValueError(f"--methods must name at least one method of {', '.join(Method)}, got {shown(text)!r}")
    for name in names:
        if name not in set(Method):
            raise ValueError(f"there is no method {shown(name)}{meant(name, list(Method))}")
    return tuple(dict.fromkeys(Method(name) for name in names))


def _crop(text: str) -> tuple[int, int, int, int]:
    parts = text.split(",")
    if len(parts) != 4 or not all(part.strip().isdecimal() and len(part) < 9 for part in parts):
        raise ValueError(f"crop must read like 120,80,160,120 (x, y, width, height in pixels), got {text!r}")
    x, y, w, h = (int(part) for part in parts)
    return x, y, w, h


def _folder(output: Path, *, overwrite: bool) -> None:
    """Make the report's folder, or refuse it."""
    import tempfile

    for name in ("index.html", "report.csv", "report.json"):
        if (output / name).exists() and not overwrite:
            raise FileExistsError(f"{output / name} exists already; give --overwrite to replace the report")
    try:
        output.mkdir(exist_ok=True)
        tempfile.TemporaryFile(dir=output).close()
    except OSError as error:
        why = (
            "it is a file" if output.is_file() else "the folder it lies in does not exist" if not output.parent.is_dir() else error.strerror
        )
        raise ValueError(f"the report's folder {output} must be writable: {why}; is -o right?") from error


def _of_words(
    source: Path,
    wanted: Sequence[Method] | None,
    truth: Path | None,
    crops: Sequence[tuple[int, int, int, int]],
    kept: Path,
    words: dict[str, Any],
) -> _Work:
    clip, about_logs = asked.is_clip(source), [name for name in words if name.startswith("gyro")]
    tried = wanted or _applying(clip=clip, recorded=bool(about_logs))
    for name in tried:
        if name.needs_clip and not clip:
            raise ValueError(f"method {name} concerns clips, it sees the motion between frames; {source} is taken for a photograph")

    def concerning(method: Method) -> dict[str, Any]:
        others = [*(about_logs if not method.recorded else ()), *(("block_rows",) if method is not Method.STITCH else ())]
        return {name: value for name, value in words.items() if name not in others} | {"method": method}

    lossless = {"codec": "ffv1"} if _pictures(source) else {}
    jobs = [asked.job(source, kept / name / _name(source), lossless | concerning(name)) for name in tried]
    return _Work(name="", jobs=jobs, truth=truth, crops=crops)


def _of_job(
    path: Path,
    wanted: Sequence[Method] | None,
    truth: Path | None,
    crops: Sequence[tuple[int, int, int, int]],
    kept: Path,
    sets: Iterable[str],
) -> list[_Work]:
    from rsvideo.batch import plan
    from rsvideo.batch.job import understood
    from rsvideo.config import yaml

    batch = plan.read(path, tuple(sets), overwrite=True)
    report = understood(*yaml.load(path)).report
    recorded = any(request.job.gyro != GyroFile() for request in batch.requests)
    tried = wanted or report.methods or _applying(clip=True, recorded=recorded)
    works = []
    for job in (request.job for request in batch.requests):
        name = job.output.stem
        jobs = [
            replace(
                job,
                method=method,
                output=kept / name / method / _name(job.source),
                gyro=job.gyro if method.recorded else GyroFile(),
                block_rows=job.block_rows if method is Method.STITCH else None,
            )
            for method in tried
        ]
        works.append(_Work(name=name, jobs=jobs, truth=truth or report.truth_of(job.source), crops=crops or report.crops))
    return works


def _compared(works: Sequence[_Work], output: Path, title: str | None, *, jobs: int, resume: bool, overwrite: bool, json: bool) -> int:
    """A page for each input; and an index of them all, with a `title`."""
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import bar
    from rsvideo.comparison import preflight
    from rsvideo.config.files import write_whole
    from rsvideo.report import page

    with quiet.c_libraries():
        works = [replace(work, jobs=preflight.settled(work.jobs, work.truth, work.crops)) for work in works]
    _folder(output, overwrite=overwrite)
    done, everyone = [], []
    with bar() as show:
        for n, work in enumerate(works):

            def part(stage: str, fraction: float, n=n, name=work.name) -> None:
                show(f"{name}: {stage}" if name else stage, (n + fraction) / len(works))

            comparison, attempts = _carried_out(work, part, jobs=jobs, resume=resume)
            (output / work.name).mkdir(exist_ok=True)
            _write(output / work.name, comparison)
            done.append((work.name, comparison))
            everyone += attempts
    _note(everyone)
    if title is not None:
        write_whole({output / "index.html": page.index(title, done), **_numbers(output, [comparison for _, comparison in done])})
    if json:
        print((output / "report.json").read_text(encoding="utf-8"), end="")
    for name, comparison in done:
        _tell(comparison, output / name)
    if title is not None:
        print(f"rsvideo: compared: {output / 'index.html'}", file=sys.stderr)
    return _code(everyone)


def _numbers(output: Path, comparisons: "Sequence[Comparison]") -> dict[Path, bytes]:
    from rsvideo.report import numbers

    return {output / "report.csv": numbers.all_csv(comparisons), output / "report.json": numbers.all_json(comparisons)}


def _carried_out(work: _Work, show: Show, *, jobs: int, resume: bool) -> "tuple[Comparison, list[Attempt]]":
    from rsvideo.cli import quiet
    from rsvideo.comparison import compare, method_run

    orders = [method_run.Order(job=job) for job in work.jobs]
    attempts = method_run.all_of(orders, most=jobs, resume=resume, quiet=quiet.wanted(), show=lambda stage, done: show(stage, 0.9 * done))
    seen = compare.compared(
        work.jobs[0], attempts, truth=work.truth, crops=work.crops, show=lambda stage, done: show(stage, 0.9 + 0.1 * done)
    )
    return seen, attempts


def _applying(*, clip: bool, recorded: bool) -> tuple[Method, ...]:
    from importlib.util import find_spec

    peer = find_spec("imageio_ffmpeg") is not None  # an extra, which is tried where it is installed
    applying = (name for name in _ALL if (clip or not name.needs_clip) and (recorded or not name.recorded))
    return tuple(name for name in applying if peer or not name.steadied)


def _name(source: Path) -> str:
    """Of a result, in a format that every method can write and that loses as little as the source's own."""
    if not asked.is_clip(source):
        return source.stem + ".png"
    if _pictures(source):
        return "".join(letter for letter in source.stem if letter not in "#%*").strip("_-. ") + ".mkv"
    from rsvideo.video.output_format import CONTAINERS

    return source.stem + (source.suffix.lower() if source.suffix.lower() in CONTAINERS else ".mkv")


def _pictures(source: Path) -> bool:
    """Whether it is a folder or a pattern, whose pictures become one lossless clip."""
    return source.is_dir() or any(mark in source.name for mark in "#%*")


def _write(output: Path, comparison: "Comparison") -> None:
    from rsvideo.config.files import write_whole
    from rsvideo.report import numbers, page

    write_whole(
        {
            output / "index.html": page.render(comparison),
            output / "report.csv": numbers.as_csv(comparison),
            output / "report.json": numbers.as_json(comparison),
        }
    )


def _tell(comparison: "Comparison", output: Path) -> None:
    from rsvideo.report.summary import summary

    for words in summary(comparison):
        print(f"rsvideo: {words}", file=sys.stderr)
    for entry in comparison.methods:
        if entry.fault is not None:
            print(f"rsvideo: {entry.name} failed: {entry.fault}", file=sys.stderr)
    print(f"rsvideo: compared: {output / 'index.html'}", file=sys.stderr)


def _note(attempts: "Sequence[Attempt]") -> None:
    for each in attempts:
        for note in each.notes:
            print(f"rsvideo: note: {each.method}: {note}", file=sys.stderr)


def _code(attempts: "Sequence[Attempt]") -> int:
    from rsvideo.cli.exit_codes import Code

    failed = [attempt for attempt in attempts if attempt.fault is not None]
    if failed and all(attempt.unreadable for attempt in attempts):
        return Code.UNREADABLE
    return Code.FAILED if failed else Code.DONE


def _table(
    cases: Path, output: Path, kind: "Format", methods: Sequence[Method], results: Path, *, jobs: int, resume: bool, overwrite: bool
) -> int:
    from rsvideo.cli import quiet
    from rsvideo.cli.exit_codes import Code
    from rsvideo.cli.progress import bar
    from rsvideo.comparison import cases as folder
    from rsvideo.config.files import write_whole
    from rsvideo.report import table

    found = folder.find(cases)
    if not output.parent.is_dir():
        raise ValueError(f"the folder {output.parent} of {output.name} must exist; make it first, or is its name mistyped?")
    if output.exists() and not overwrite:
        raise FileExistsError(f"{output} exists already; give --overwrite to replace it")
    with bar() as show:
        told = folder.scored(found, methods, results, most=jobs, resume=resume, quiet=quiet.wanted(), show=show)
    write_whole({output: table.written(told, kind).encode()})
    for note in told.notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
    print(f"rsvideo: {len(told.rows)} cases, {len(methods)} methods: {output}", file=sys.stderr)
    return Code.FAILED if told.failed else Code.DONE
