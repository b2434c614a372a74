"""A clip's settings as a job's file that `rsvideo run` takes, with a comment on each."""

import json
import re
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rsvideo.batch import plan
from rsvideo.batch.job import Output
from rsvideo.config.files import made_within
from rsvideo.config.placing import aside, check_free, place
from rsvideo.config.printable import printable
from rsvideo.config.request import option_fields
from rsvideo.view.fields import Stated
from rsvideo.view.opened import is_plain

_WIDTH = 110
_PLAIN = re.compile(r"[A-Za-z0-9][\w./+-]*")  # what YAML and our own reader take for text, or for the number that it is


def text(source: str, stated: Stated, sources: Mapping[str, str]) -> str:
    """The file. `source` is the clip's path from the file's folder.

    `sources` says of settings that are left out, by key, what holds and who states it.
    """
    lines = [
        f"# Restores {printable(Path(source).name)} with the settings that were tried on its page.",
        "# rsvideo run takes this file: it goes on after an interruption, and --dry-run only shows the plan.",
        "output:",
        f"  folder: {Output().folder}  # relative to this file",
        f"  name: {json.dumps(Output().name)}  # with the source's stem and suffix",
        "clips:",
        f"  - source: {_scalar(source)}  # relative to this file",
    ]
    fields = {each.key: each for each in option_fields()}
    for section, values in stated.items():
        given = {name: value for name, value in values.items() if value not in (None, "")}
        if given:
            lines.append(f"    {section}:")
        for name, value in given.items():
            field = fields[f"{section}.{name}"]
            lines += [f"      # {line}" for line in textwrap.wrap(printable(field.option.help), _WIDTH - 8)]
            lines.append(f"      {name}: {_scalar(value)}")
    left = [
        (key, words) for key, words in sources.items() if key in fields and not stated.get(fields[key].section, {}).get(fields[key].name)
    ]
    if left:
        lines.append("    # Left out, and so taken from who states it:")
    lines += [f"    #   {line}" for key, words in left for line in textwrap.wrap(printable(f"{key} is {words}"), _WIDTH - 8)]
    return "\n".join(lines) + "\n"


def _scalar(value: Any) -> str:
    """A value in YAML; text that could be taken for anything else is quoted."""
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    if isinstance(value, int | float):
        return repr(value)
    words = str(value)
    quoted = not _PLAIN.fullmatch(words) or words.lower() in ("null", "true", "false")
    return json.dumps(words, ensure_ascii=True) if quoted else words


def save(folder: Path, name: str, content: str, *, overwrite: bool) -> Path:
    """Write the file as `NAME.yaml` if `rsvideo run` takes it; ValueError, FileExistsError, UnreadableError or OSError."""
    stem = name.removesuffix(".yaml").removesuffix(".yml").strip()
    if not is_plain(stem):
        raise ValueError(f"a job's name must be a plain file name such as my_clip, got {printable(name)[:80]!r}")
    path = folder / f"{stem}.yaml"
    if path.is_symlink() or path.is_dir():
        raise ValueError(f"{path.name} is a link or a folder; give the job another name")
    check_free(path, overwrite=overwrite)
    with aside(folder) as within:
        made = made_within(within, path, content.encode())
        trial = folder / f".{path.name}.part"  # names in it are relative to this folder
        try:
            trial.write_text(content, encoding="utf-8")
            plan.read(trial)
        finally:
            trial.unlink(missing_ok=True)
        place([made])
    return path
