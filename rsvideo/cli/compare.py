"""rsvideo compare: several methods on one input, a job's sources or a folder of cases, and who wins."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Option

from rsvideo.cli import options
from rsvideo.cli.exit_codes import note, refusing
from rsvideo.cli.terminal import say
from rsvideo.cli.validate import Sets
from rsvideo.config.media import SEQUENCES, is_clip, is_sequence
from rsvideo.config.method import Method

if TYPE_CHECKING:
    from rsvideo.comparison.method_run import MethodRun
    from rsvideo.config.request import Request
    from rsvideo.progress import Observer
    from rsvideo.report.comparison import Comparison
    from rsvideo.report.table import Format

Crops = Sequence[tuple[int, int, int, int]]
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
_FILES = ("index.html", "report.csv", "report.json")  # of a report
_FORMATS: dict[str, "Format"] = {".md": "markdown", ".tex": "latex", ".csv": "csv"}


@options.offers(
    "camera",
    *("motion.model", "motion.trajectory", "motion.gyro", "motion.gyro_offset", "motion.gyro_axes"),
    *(
        "deblur.prior",
        "deblur.frames",
        "deblur.device",
        "deblur.block_rows",
        "input.range",
        "input.rate",
        "encoding.codec",
        "encoding.crf",
    ),
)
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
    jobs: Annotated[
        int, Option("-j", "--jobs", metavar="N", min=1, max=options.MOST_JOBS, help="Methods at a time; times are fair with 1.")
    ] = 1,
    resume: Annotated[bool, Option("--resume/--fresh", help="Take results of the same request that are there, or make them anew.")] = True,
    given: options.Given = options.NOTHING,
    sets: Sets = None,
    overwrite: Annotated[
        bool, Option("--overwrite", help="Replace the report, or the table, and what stands in the way of results.")
    ] = False,
    json: Annotated[bool, Option("--json", help="Print report.json on standard output.")] = False,
) -> int:
    """Try several methods, and show who wins and why: a page (index.html) to open, the same numbers in report.csv and report.json.

    Each method runs in a process of its own, so that its time and memory are its own; one that fails is shown with its reason.

    Exit codes: 0 all done; 1 a method failed; 2 the request is wrong; 3 an input is damaged or missing; 4 a report exists.
    """
    with refusing():
        wanted = _Wanted(
            methods=None if methods is None else _methods(methods), truth=truth, crops=[_crop(text) for text in crop or ()], given=given
        )
        if output is None:
            raise ValueError("-o must say where the report goes: a folder, or the file of the table")
        if (source is None) == (table is None):
            raise ValueError("one input must be given: a photograph, a clip or a job's file, or --table with a folder of cases")
        how = _How(jobs=jobs, resume=resume, overwrite=overwrite)
        if table is not None:
            return _table(table, output, format_, wanted, results, how)
        assert source is not None
        works, title = _works(source, wanted, results or output / "results", sets or ())
        return _compared(works, output, title, how, json=json)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Wanted:
    """What is to be tried, with which options, and measured against what."""

    methods: Sequence[Method] | None  # None: those that apply
    truth: Path | None
    crops: Crops
    given: options.Given


@dataclass(frozen=True, kw_only=True)
class _How:
    """How the work is carried out."""

    jobs: int
    resume: bool
    overwrite: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class _Work:
    """One input, and what is tried on it."""

    name: str
    requests: "Sequence[Request]"
    truth: Path | None
    crops: Crops


def _works(source: Path, wanted: _Wanted, kept: Path, sets: Sequence[str]) -> tuple[list[_Work], str | None]:
    """What is tried on the input or on each of a job's sources, and the title of their index."""
    if source.suffix.lower() in (".yaml", ".yml"):
        if wanted.given:
            flag = options.flag(next(iter(wanted.given)))
            raise ValueError(f"{flag} cannot be given with a job's file, which says it; --set camera.exposure=1/50 does")
        return _of_job(source, wanted, kept, sets), source.stem
    if sets:
        raise ValueError("--set is for a job's file")
    return [_of_source(source, wanted, kept)], None


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


def _folder(output: Path, works: Sequence[_Work], *, overwrite: bool) -> None:
    """Make the report's folder, or refuse it."""
    import tempfile

    from rsvideo.config import placing

    folders = dict.fromkeys([output, *(output / work.name for work in works)])
    read = [path for work in works for path in (*work.requests[0].inputs, *([work.truth] if work.truth else []))]
    placing.check([folder / name for folder in folders for name in _FILES], read, overwrite=overwrite)
    try:
        output.mkdir(exist_ok=True)
        tempfile.TemporaryFile(dir=output).close()
    except OSError as error:
        why = (
            "it is a file" if output.is_file() else "the folder it lies in does not exist" if not output.parent.is_dir() else error.strerror
        )
        raise ValueError(f"the report's folder {output} must be writable: {why}; is -o right?") from error


def _of_source(source: Path, wanted: _Wanted, kept: Path) -> _Work:
    given = wanted.given
    if (codec := given.get("encoding.codec")) in SEQUENCES:
        raise ValueError(f"codec must be one that clips are kept in, {codec} writes folders of pictures")
    clip, of_logs = is_clip(source), any(key.startswith("motion.gyro") for key in given)
    tried = wanted.methods or _applying(clip=clip, logs=of_logs)
    for name in tried:
        if name.needs_clip and not clip:
            raise ValueError(f"method {name} concerns clips, it sees the motion between frames; {source} is taken for a photograph")
    lossless = {"encoding.codec": "ffv1"} if is_sequence(source) else {}
    request = options.request(source, kept / _name(source), {**lossless, **given})
    requests = [_by_method(request, name, kept / name / _name(source)) for name in tried]
    return _Work(name="", requests=requests, truth=wanted.truth, crops=wanted.crops)


def _of_job(path: Path, wanted: _Wanted, kept: Path, sets: Iterable[str]) -> list[_Work]:
    from rsvideo.batch import cache, plan

    batch = plan.read(path, tuple(sets), overwrite=True)
    for origin in (item.request.origin for item in batch.items):
        if origin:
            cache.bring(origin)
    logs = any(item.request.motion.states_gyro for item in batch.items)
    works = []
    for request in (item.request for item in batch.items):
        name = request.output.stem
        listed = wanted.methods or batch.report.methods or _applying(clip=request.is_clip, logs=logs)
        tried = (method for method in listed if request.is_clip or not method.needs_clip)
        requests = [_by_method(request, method, kept / name / method / _name(request.source)) for method in tried]
        truth = wanted.truth or batch.report.truth_of(request.source)
        works.append(_Work(name=name, requests=requests, truth=truth, crops=wanted.crops or batch.report.crops))
    return works


def _by_method(request: "Request", method: Method, output: Path) -> "Request":
    """The same request for another method, without the options that concern others only."""
    no_log = {} if method.follows_gyro else dict.fromkeys(("gyro", "gyro_offset", "gyro_axes"))
    no_blocks = {} if method is Method.STITCH else {"block_rows": None}
    return request.replaced(output=output, motion=no_log, deblur={"method": method, **no_blocks})


def _compared(works: Sequence[_Work], output: Path, title: str | None, how: _How, *, json: bool) -> int:
    """A page for each input; and an index of them all, with a `title`."""
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import progress_bar
    from rsvideo.comparison import method_run, preflight
    from rsvideo.config.files import write_whole
    from rsvideo.progress import within
    from rsvideo.report import page

    with quiet.c_libraries():
        works = [replace(work, requests=preflight.settled(work.requests, work.truth, work.crops)) for work in works]
    for work in works:
        method_run.check([method_run.Order(request=request) for request in work.requests], overwrite=how.overwrite)
    _folder(output, works, overwrite=how.overwrite)
    done, everyone = [], []
    with progress_bar() as observe:
        for n, work in enumerate(works):
            part = within(observe, n / len(works), (n + 1) / len(works), f"{work.name}: " if work.name else "")
            comparison, runs = _carried_out(work, part, how)
            (output / work.name).mkdir(exist_ok=True)
            _write(output / work.name, comparison)
            done.append((work.name, comparison))
            everyone += runs
    _note(everyone)
    if title is not None:
        write_whole({output / "index.html": page.index(title, done), **_numbers(output, [comparison for _, comparison in done])})
    if json:
        print((output / "report.json").read_text(encoding="utf-8"), end="")
    for name, comparison in done:
        _tell(comparison, output / name)
    if title is not None:
        say(f"compared: {output / 'index.html'}")
    return _code(everyone)


def _numbers(output: Path, comparisons: "Sequence[Comparison]") -> dict[Path, bytes]:
    from rsvideo.report import numbers

    return {output / "report.csv": numbers.all_csv(comparisons), output / "report.json": numbers.all_json(comparisons)}


def _carried_out(work: _Work, observe: "Observer", how: _How) -> "tuple[Comparison, list[MethodRun]]":
    from rsvideo.cli import quiet
    from rsvideo.comparison import compare, method_run
    from rsvideo.progress import within

    orders = [method_run.Order(request=request) for request in work.requests]
    runs = method_run.all_of(
        orders, most=how.jobs, resume=how.resume, quiet=quiet.wanted(), observe=within(observe, 0.0, method_run.RUNNING)
    )
    measured = compare.compared(
        work.requests[0], runs, truth=work.truth, crops=work.crops, observe=within(observe, method_run.RUNNING, 1.0)
    )
    return measured, runs


def _applying(*, clip: bool, logs: bool) -> tuple[Method, ...]:
    """The methods that apply to a clip or a photograph, those that follow a gyroscope's log where there are any."""
    from importlib.util import find_spec

    peer = find_spec("imageio_ffmpeg") is not None  # an extra, which is tried where it is installed
    applying = (name for name in _ALL if (clip or not name.needs_clip) and (logs or not name.follows_gyro))
    return tuple(name for name in applying if peer or not name.steadied)


def _name(source: Path) -> str:
    """Of a result, in a format that every method can write and that loses as little as the source's own."""
    if not is_clip(source):
        return source.stem + ".png"
    if is_sequence(source):  # whose pictures become one lossless clip
        return "".join(letter for letter in source.stem if letter not in "#%*").strip("_-. ") + ".mkv"
    from rsvideo.video.output_format import CONTAINERS

    return source.stem + (source.suffix.lower() if source.suffix.lower() in CONTAINERS else ".mkv")


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
        say(words)
    for entry in comparison.methods:
        if entry.fault is not None:
            say(f"{entry.name} failed: {entry.fault}")
    say(f"compared: {output / 'index.html'}")


def _note(runs: "Sequence[MethodRun]") -> None:
    for each in runs:
        note(f"{each.method}: {words}" for words in each.notes)


def _code(runs: "Sequence[MethodRun]") -> int:
    from rsvideo.cli.exit_codes import Code

    failed = [run for run in runs if run.fault is not None]
    if failed and all(run.unreadable for run in runs):
        return Code.UNREADABLE
    return Code.FAILED if failed else Code.DONE


def _table(cases: Path, output: Path, form: "Format | None", wanted: _Wanted, results: Path | None, how: _How) -> int:
    from rsvideo.cli import quiet
    from rsvideo.cli.exit_codes import Code
    from rsvideo.cli.progress import progress_bar
    from rsvideo.comparison import cases as folder
    from rsvideo.config.files import write_whole
    from rsvideo.config.placing import check_free
    from rsvideo.report import table

    stated = [*map(options.flag, wanted.given), *(["--truth"] if wanted.truth else []), *(["--crop"] if wanted.crops else [])]
    if stated:
        raise ValueError(f"{stated[0]} cannot be given with --table: each case says it by itself")
    form = form or _FORMATS.get(output.suffix.lower())
    if form is None:
        raise ValueError(f"{output} must end in {', '.join(_FORMATS)}, it ends in {output.suffix!r}; or --format says what it holds")
    found = folder.find(cases)
    if not output.parent.is_dir():
        raise ValueError(f"the folder {output.parent} of {output.name} must exist; make it first, or is its name mistyped?")
    check_free(output, overwrite=how.overwrite)
    methods, kept = wanted.methods or _TABLE, results or output.with_name(output.stem + "_results")
    with progress_bar() as observe:
        scores = folder.scored(
            found, methods, kept, most=how.jobs, resume=how.resume, overwrite=how.overwrite, quiet=quiet.wanted(), observe=observe
        )
    write_whole({output: table.written(scores, form).encode()})
    note(scores.notes)
    say(f"{len(scores.rows)} cases, {len(methods)} methods: {output}")
    return Code.FAILED if scores.failed else Code.DONE
