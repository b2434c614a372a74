"""A folder of cases with their truth, and how near each method comes to it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field, ValidationError

from rsvideo.comparison.decoded import pictures
from rsvideo.comparison.method_run import RUNNING, MethodRun, Order, all_of, check
from rsvideo.config.files import UnreadableError, read_whole
from rsvideo.config.method import Method
from rsvideo.config.request import Request
from rsvideo.physics.shutter import Direction
from rsvideo.physics.tone import Transfer
from rsvideo.progress import Observer, Progress, within
from rsvideo.report import metrics
from rsvideo.report.table import DOES_NOT_APPLY, Row, Table

MOST_CASES = 10_000
_MOST_CASE_BYTES = 1_000_000  # of a case.json, which has a few hundred
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Shot(BaseModel):
    """How a case was rendered, as far as restoring needs it."""

    exposure_s: _Positive
    row_time_s: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    focal_px: _Positive
    direction: Direction = Direction.TOP_TO_BOTTOM
    transfer: Transfer | None = None


class Case(BaseModel):
    """A blurred input, its truth, and its shutter and lens."""

    name: str
    kind: str
    clip: bool
    source: Path
    truth: Path
    shot: _Shot


def find(folder: Path) -> list[Case]:
    """The cases stills/NAME (blurred.png, truth.png) and clips/NAME (clip.mp4, truth.mp4), each with its case.json."""
    if not folder.is_dir():
        raise UnreadableError(f"{folder} {'is a file, not a folder of cases' if folder.exists() else 'does not exist'}")
    found = sorted(folder.glob("stills/*/case.json")) + sorted(folder.glob("clips/*/case.json"))
    if not found:
        raise UnreadableError(f"{folder} must hold cases, stills/NAME/case.json or clips/NAME/case.json; there is none")
    if len(found) > MOST_CASES:
        raise UnreadableError(f"{folder} must hold at most {MOST_CASES} cases, it holds {len(found)}")
    cases = [_case(path) for path in found]
    names = [case.name for case in cases]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise UnreadableError(f"{folder}: a still and a clip are both called {twice}; their results would be one file")
    return cases


def _case(path: Path) -> Case:
    try:
        shot = _Shot.model_validate_json(read_whole(path, most=_MOST_CASE_BYTES))
    except ValidationError as error:
        first = error.errors()[0]
        raise UnreadableError(f"{path}: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error
    home, clip = path.parent, path.parent.parent.name == "clips"
    source, truth = (home / name for name in (("clip.mp4", "truth.mp4") if clip else ("blurred.png", "truth.png")))
    for each in (source, truth):
        if not each.is_file():
            raise UnreadableError(f"{each} does not exist; a case holds its input and its truth")
    kind = "clips" if clip else home.name.rsplit("_", 1)[0]
    return Case(name=home.name, kind=kind, clip=clip, source=source, truth=truth, shot=shot)


def scored(
    cases: Sequence[Case],
    methods: Sequence[Method],
    results: Path,
    *,
    most: int,
    resume: bool,
    overwrite: bool,
    quiet: bool,
    observe: Observer,
) -> Table:
    """Carry every method out on every case into results/METHOD/NAME, and measure; `overwrite` what no comparison made there."""
    orders = {
        (case.name, method): Order(request=_request(case, method, results / method / f"{case.name}{case.source.suffix}"))
        for case in cases
        for method in methods
        if case.clip or not method.needs_clip
    }
    check(orders.values(), overwrite=overwrite)
    done = all_of(list(orders.values()), most=most, resume=resume, quiet=quiet, observe=within(observe, 0.0, RUNNING))
    made = dict(zip(orders, done, strict=True))
    rows = []
    for n, case in enumerate(cases):
        observe(Progress(stage=f"measuring {case.name}", fraction=RUNNING + (1 - RUNNING) * n / len(cases)))
        psnr, why_not = {}, {}
        for method in methods:
            run = made.get((case.name, method))
            if run is None:
                why_not[method.value] = DOES_NOT_APPLY
            elif run.fault is not None:
                why_not[method.value] = run.fault
            else:
                psnr[method.value] = _psnr(run, case)
        rows.append(Row(kind=case.kind, case=case.name, psnr=psnr, why_not=why_not))
    return Table(methods=tuple(method.value for method in methods), rows=tuple(rows))


def _psnr(run: MethodRun, case: Case) -> float:
    """Of a still, or the mean over a clip's frames."""
    pairs = zip(pictures(run.output), pictures(case.truth), strict=True)
    return float(np.mean([metrics.psnr(ours.codes, truth.codes) for ours, truth in pairs]))


def _request(case: Case, method: Method, output: Path) -> Request:
    shot = case.shot
    return Request.model_validate(
        {
            "source": case.source,
            "output": output,
            "overwrite": True,
            "camera": {
                "exposure": shot.exposure_s,
                "row_time": shot.row_time_s,
                "direction": shot.direction,
                "focal_px": shot.focal_px,
            },
            "deblur": {"method": method},
        }
    )
