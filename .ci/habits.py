"""Prints how large the code is, how fast it starts and how often it uses words that hide what they mean; exits 1 beyond a limit.

Run it from anywhere: `python .ci/habits.py`. It needs the standard library only; the project is imported for the timing alone, by
fresh interpreters.
"""

import ast
import io
import re
import statistics
import subprocess
import sys
import time
import tokenize
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("rsvideo", "calibration")

MOST_LINES_OF_A_FILE = 399
MOST_LINES_OF_A_FUNCTION = 59  # its signature and docstring count, its decorators do not
SLOWEST_IMPORT = 2.0  # seconds; 0.3 on a quiet machine, the rest is for a busy one
STARTS = 5  # fresh interpreters; the median is printed

# These words do not say what a thing is: a "known" motion may be given, measured or simulated.
VAGUE = {"asked", "attempt", "attempts", "ending", "known", "looks", "recorded", "said", "seen", "shots", "told", "way", "ways"}
MOST_VAGUE_NAMES = 0
MOST_VAGUE_WORDS = 0

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")  # of snake_case, CamelCase and prose alike


@dataclass(frozen=True, kw_only=True)
class Function:
    """A function's size."""

    where: str  # file:line name
    lines: int
    parameters: int  # without self and cls


@dataclass(frozen=True, kw_only=True)
class File:
    """What is counted in a file."""

    path: str
    room: str
    lines: int
    functions: list[Function]
    vague_names: list[str]  # distinct names
    vague_words: Counter[str]  # of docstrings and comments


def main() -> int:
    """Print the numbers; 1 where one of them is beyond its limit, else 0."""
    files = [measured(path) for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    broken = [*sizes(files), *vagueness(files), *starts()]
    for line in broken:
        print(f"beyond its limit: {line}")
    return 1 if broken else 0


def measured(path: Path) -> File:
    """One file's numbers."""
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    where = path.relative_to(ROOT)
    inner = where.parts[1:-1]
    names = {*names_bound(tree), path.stem}
    return File(
        path=str(where),
        room="/".join((where.parts[0], *inner[:1])),
        lines=source.count("\n"),
        functions=[sized(node, where) for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)],
        vague_names=sorted(name for name in names if vague(name)),
        vague_words=Counter(word for text in prose(source, tree) for word in vague(text)),
    )


def sized(node: ast.FunctionDef | ast.AsyncFunctionDef, where: Path) -> Function:
    """A function's lines and parameters."""
    a = node.args
    parameters = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, (a.vararg, a.kwarg))]
    return Function(
        where=f"{where}:{node.lineno} {node.name}",
        lines=(node.end_lineno or node.lineno) - node.lineno + 1,
        parameters=sum(parameter.arg not in ("self", "cls") for parameter in parameters),
    )


def names_bound(tree: ast.AST) -> Iterator[str]:
    """Names that the file gives: to functions, classes, parameters, variables and attributes; not those that it uses."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.arg(arg=name) | ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name
            case ast.alias(asname=str(name)):
                yield name


def prose(source: str, tree: ast.AST) -> Iterator[str]:
    """Docstrings and comments."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


def vague(text: str) -> list[str]:
    """The vague words in it."""
    return [word for word in map(str.lower, _WORD.findall(text)) if word in VAGUE]


def sizes(files: list[File]) -> Iterator[str]:
    """Print the largest files and functions; yield those beyond a limit."""
    functions = sorted((function for file in files for function in file.functions), key=lambda function: -function.lines)
    longest = max(files, key=lambda file: file.lines)
    widest = max(functions, key=lambda function: function.parameters)
    print(f"{len(files)} files, {sum(file.lines for file in files)} lines, {len(functions)} functions")
    print(f"longest file      {longest.lines:4} lines       {longest.path}")
    print(f"longest function  {functions[0].lines:4} lines       {functions[0].where}")
    print(f"widest signature  {widest.parameters:4} parameters  {widest.where}")
    for file in files:
        if file.lines > MOST_LINES_OF_A_FILE:
            yield f"{file.lines} lines, at most {MOST_LINES_OF_A_FILE}: {file.path}"
    for function in functions:
        if function.lines > MOST_LINES_OF_A_FUNCTION:
            yield f"{function.lines} lines, at most {MOST_LINES_OF_A_FUNCTION}: {function.where}"


def vagueness(files: list[File]) -> Iterator[str]:
    """Print the vague names and words of each room; yield a sum beyond its limit."""
    print(f"\n{'vague':28}{'names':>6}{'words':>6}  the most frequent")
    for room in dict.fromkeys(file.room for file in files):
        inside = [file for file in files if file.room == room]
        names = Counter(name for file in inside for name in file.vague_names)
        words = Counter[str]()
        for file in inside:
            words.update(file.vague_words)
        if names or words:
            frequent = ", ".join(f"{name} {count}" for name, count in names.most_common(4))
            print(f"  {room:26}{names.total():6}{words.total():6}  {frequent}")
    names = sum(len(file.vague_names) for file in files)
    words = sum(file.vague_words.total() for file in files)
    print(f"  {'all':26}{names:6}{words:6}")
    for kind, count, most in (("names", names, MOST_VAGUE_NAMES), ("words", words, MOST_VAGUE_WORDS)):
        if count > most:
            yield f"{count} vague {kind}, at most {most}"
        elif count < most:
            print(f"  MOST_VAGUE_{kind.upper()} in {Path(__file__).name} may fall from {most} to {count}")


def starts() -> Iterator[str]:
    """Print how long imports and the command take; yield an import that takes too long."""
    print(f"\nmedian of {STARTS} starts, seconds without the interpreter's own")
    for package in PACKAGES:
        seconds = start(f"import {package}")
        print(f"  {f'import {package}':26}{seconds:6.2f}")
        if seconds > SLOWEST_IMPORT:
            yield f"import {package} takes {seconds:.2f} s, at most {SLOWEST_IMPORT:.1f} s"
    print(f"  {'rsvideo --help':26}{start('from rsvideo.cli import main; main()', '--help'):6.2f}")


def start(program: str, *words: str) -> float:
    """Seconds that fresh interpreters take to run a program, less what they take to run none."""
    took: dict[str, list[float]] = {"": [], program: []}
    for _ in range(STARTS):
        for each, seconds in took.items():
            begun = time.perf_counter()
            subprocess.run([sys.executable, "-c", each, *words], cwd=ROOT, capture_output=True, check=True)
            seconds.append(time.perf_counter() - begun)
    return max(0.0, statistics.median(took[program]) - statistics.median(took[""]))


if __name__ == "__main__":
    sys.exit(main())
