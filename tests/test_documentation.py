"""What the documentation names exists: files, functions, verbs and options; and the front page stays short."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache, reduce
from pathlib import Path
from typing import Any

import pytest
import typer.main

import rsvideo.cli

CHECKOUT = Path(__file__).resolve().parent.parent
PAGES = [CHECKOUT / "README.md", CHECKOUT / "samples" / "README.md", *sorted((CHECKOUT / "docs").rglob("*.md"))]
CODE = sorted(file for folder in ("rsvideo", "calibration", "samples", "tests") for file in (CHECKOUT / folder).rglob("*.py"))
ROOMS = {folder.name for folder in (CHECKOUT / "rsvideo").iterdir() if (folder / "__init__.py").is_file()}
MADE = {"report.csv", "report.json"}  # files that a command writes, and keys of jobs, look like modules of a room
LONGEST = 120  # lines of the front page

FILE = re.compile(r"(?<![\w./-])((?:rsvideo|calibration|tests|configs|samples|docs|\.ci)/[\w./-]*\w/?)(?::([A-Za-z_][\w.]*))?")
DOTTED = re.compile(r"(?<![\w./>-])((?:rsvideo|calibration)(?:\.[A-Za-z_]\w*)+)")
ROOM = re.compile(rf"(?<![\w./-])((?:{'|'.join(sorted(ROOMS))})\.[a-z_]\w*)(?![\w./])")
SPAN = re.compile(r"`([^`\n]+)`")
SCRIPT = re.compile(r"tests/benchmarks/(\w+)\.py")
OPTION = re.compile(r"(?<![\w-])(--[a-z][\w-]*)")


def shown(file: Path) -> str:
    return str(file.relative_to(CHECKOUT))


def docstrings(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
            yield text


@cache
def names(module: Path) -> frozenset[str]:
    """What a file defines, attributes of its classes as Class.attribute; of a package also what it says that it exports."""
    out: set[str] = set()
    for node in ast.parse(module.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            out.add(node.name)
        if isinstance(node, ast.ClassDef):
            defined = (n for n in node.body if isinstance(n, ast.FunctionDef))
            out |= {f"{node.name}.{n.name}" for n in defined}
            out |= {f"{node.name}.{n.target.id}" for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)}
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            out |= {t.id for t in targets if isinstance(t, ast.Name)}
            if node.value is not None and any(isinstance(t, ast.Name) and t.id == "__all__" for t in targets):
                out |= {e.value for e in ast.walk(node.value) if isinstance(e, ast.Constant) and isinstance(e.value, str)}
    return frozenset(out)


def resolves(dotted: str) -> bool:
    """Whether a.b.c is a module, or a name in one."""
    parts = dotted.split(".")
    if parts[0] == "rsvideo" and parts[1] in rsvideo.__all__:  # these are loaded when they are first used
        return reduce(lambda place, part: getattr(place, part, None), parts[1:], rsvideo) is not None
    for n in range(len(parts), 0, -1):
        base = CHECKOUT.joinpath(*parts[:n])
        module = base / "__init__.py" if base.is_dir() else base.with_suffix(".py")
        if module.is_file():
            return n == len(parts) or ".".join(parts[n:]) in names(module)
    return False


def wrong_names(text: str) -> Iterator[str]:
    for path, name in FILE.findall(text):
        file = CHECKOUT / path.rstrip(".")
        if not (file.is_dir() if path.endswith("/") else file.exists()):
            yield path
        elif name and name not in names(file):
            yield f"{path}:{name}"
    for dotted in DOTTED.findall(text):
        if not dotted.endswith((".json", ".yaml")) and not resolves(dotted):
            yield dotted


def commands(text: str) -> Iterator[str]:
    """Code spans and lines of code, indented or fenced."""
    fenced = False
    for line in text.splitlines():
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif fenced or line.startswith("    "):
            yield line.strip()
        else:
            yield from SPAN.findall(line)


@cache
def verbs() -> dict[str, frozenset[str]]:
    """The options of each verb of the command."""

    def walk(command: Any, name: str) -> Iterator[tuple[str, frozenset[str]]]:
        parameters = command.get_params(typer.Context(command))
        options = {option for parameter in parameters for option in (*parameter.opts, *parameter.secondary_opts)}
        yield name, frozenset(options | {"--help", "--version"})
        for verb, below in getattr(command, "commands", {}).items():
            yield from walk(below, f"{name} {verb}".strip())

    return dict(walk(typer.main.get_command(rsvideo.cli.app), ""))


@cache
def of_benchmark(name: str) -> frozenset[str]:
    """The options that a benchmark's file names."""
    return frozenset(OPTION.findall((CHECKOUT / "tests" / "benchmarks" / f"{name}.py").read_text(encoding="utf-8")))


def wrong_options(command: str, page: str = "") -> Iterator[str]:
    """Verbs and options that do not exist; an option by itself is one of any verb, or of a benchmark that the page names."""
    if re.search(r"\b(pip|pytest|mkdocs|ruff|sbatch|openjd|dask)\b", command):
        return
    verb = re.match(r"(?:\.venv/bin/)?rsvideo (calibrate [a-z]+|[a-z]+)(?![a-z_/.])", command)
    if verb and verb[1] not in verbs():
        yield f"rsvideo {verb[1]}"
        return
    allowed = verbs()[verb[1]] if verb else frozenset[str]().union(*verbs().values())
    for benchmark in SCRIPT.findall(command if verb else f"{command} {page}"):
        allowed |= of_benchmark(benchmark)
    for option in OPTION.findall(command.split(" # ")[0]):
        if option not in allowed:
            yield f"{option} of {command}"


def test_the_front_page_is_short():
    assert len((CHECKOUT / "README.md").read_text(encoding="utf-8").splitlines()) <= LONGEST


def test_the_front_page_ends_its_start_with_the_tests_command():
    start = (CHECKOUT / "README.md").read_text(encoding="utf-8").split("\n## Start\n")[1].split("\n## ")[0]
    lines = [line for line in start.splitlines() if line.startswith("    ")]
    assert len(lines) == 2
    assert lines[-1].endswith("pytest -n 2")


@pytest.mark.parametrize("page", PAGES, ids=shown)
def test_every_file_and_function_that_a_page_names_exists(page):
    assert sorted(set(wrong_names(page.read_text(encoding="utf-8")))) == []


@pytest.mark.parametrize("folder", ["rsvideo", "calibration", "samples", "tests"])
def test_every_file_and_function_that_a_docstring_names_exists(folder):
    wrong = []
    for file in CODE:
        if (CHECKOUT / folder) in file.parents:
            for text in docstrings(file):
                rooms = (name for name in ROOM.findall(text) if name not in MADE and not resolves(f"rsvideo.{name}"))
                wrong += [f"{shown(file)}: {name}" for name in (*wrong_names(text), *rooms)]
    assert sorted(set(wrong)) == []


@pytest.mark.parametrize("page", PAGES, ids=shown)
def test_every_verb_and_option_that_a_page_names_exists(page):
    text = page.read_text(encoding="utf-8")
    assert sorted({name for command in commands(text) for name in wrong_options(command, text)}) == []


def test_the_checks_notice_what_does_not_exist():
    assert [*wrong_names("`rsvideo/physics/shutter.py:ShutterTiming.readout`, `rsvideo.physics.shutter.Direction`, rsvideo/physics/")] == []
    assert [*wrong_names("`rsvideo/physics/shuter.py`")] == ["rsvideo/physics/shuter.py"]
    assert [*wrong_names("`rsvideo/physics/shutter.py:Timing`")] == ["rsvideo/physics/shutter.py:Timing"]
    assert [*wrong_names("see rsvideo.physics.shutter.Timing")] == ["rsvideo.physics.shutter.Timing"]
    assert [*wrong_options("rsvideo deblur a -o b --exposure 1/50")] == []
    assert [*wrong_options("rsvideo deblur a -o b --expose 1/50")] == ["--expose of rsvideo deblur a -o b --expose 1/50"]
    assert [*wrong_options("rsvideo blur a")] == ["rsvideo blur"]
    assert [*wrong_options("--table")] == []
    assert [*wrong_options("--tables")] == ["--tables of --tables"]


def test_the_tables_of_results_are_those_of_the_published_figures():
    check = [sys.executable, CHECKOUT / "tests" / "benchmarks" / "published.py", "--check"]
    done = subprocess.run(check, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, "")
