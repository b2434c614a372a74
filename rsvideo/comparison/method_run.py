"""One method on one input, in a process of its own: its time and memory are its own, and so is its failure."""

import contextlib
import json
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from rsvideo.config import placing
from rsvideo.config.files import UnreadableError, write_whole
from rsvideo.config.request import Request
from rsvideo.pipeline import deblur, fingerprint, processes
from rsvideo.pipeline.prepare import prepare
from rsvideo.progress import Observer, Progress

_EVERY = 0.1  # seconds between two reports on the work
RUNNING = 0.9  # of a comparison's work, as its progress counts it; measuring is the rest; origin: by trial


@dataclass(frozen=True, kw_only=True, eq=False)
class Order:
    """A request that one method is to carry out."""

    request: Request

    @property
    def method(self) -> str:
        """Its name."""
        return str(self.request.deblur.method)

    @property
    def note(self) -> Path:
        """Where it is written down what became of it."""
        return self.request.output.with_name(self.request.output.name + ".attempt.json")


@dataclass(frozen=True, kw_only=True)
class MethodRun:
    """What a method came to."""

    method: str
    output: Path
    seconds: float  # of work; the start of a process and its imports do not count
    peak_bytes: int  # of the whole process
    fault: str | None = None  # why there is no result
    unreadable: bool = False  # the input is at fault
    notes: tuple[str, ...] = ()

    @property
    def record(self) -> Path:
        """The sidecar."""
        return self.output.with_suffix(".rsvideo.json")


def kept(order: Order) -> MethodRun | None:
    """What an earlier run came to, if that was the same request to the same program, and its result is still there."""
    try:
        held = json.loads(order.note.read_text(encoding="utf-8"))
        if held.pop("fingerprint") != _fingerprint(order) or not order.request.output.exists():
            return None
        return MethodRun(method=order.method, output=order.request.output, **{**held, "notes": tuple(held["notes"])})
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def runs_of(orders: Sequence[Order], *, most: int = 1, quiet: bool = True, observe: Observer) -> Iterator[MethodRun]:
    """Carry the orders out, `most` at a time, and hand over what each came to as it ends; whoever stops listening ends them all."""
    waiting, running = list(orders), dict[Connection, tuple[Order, BaseProcess]]()
    done = 0
    threads = processes.threads(most)
    try:
        while waiting or running:
            while waiting and len(running) < most:
                order = waiting.pop(0)
                order.request.output.parent.mkdir(parents=True, exist_ok=True)
                write_whole({order.note: b"{}"})  # what appears beside it from now on is ours
                connection, child = processes.started(_serve, order, threads=threads, quiet=quiet)
                running[connection] = order, child
            for connection in wait(list(running)):
                assert isinstance(connection, Connection)
                order, child = running[connection]
                try:
                    answer = connection.recv()
                except (EOFError, OSError):
                    fault = f"its process {processes.death(child)}"
                    answer = MethodRun(method=order.method, output=order.request.output, seconds=0.0, peak_bytes=0, fault=fault)
                if isinstance(answer, Progress):
                    observe(Progress(stage=f"{order.method}: {answer.stage}", fraction=(done + answer.fraction) / len(orders)))
                    continue
                _ended(connection, child)
                del running[connection]
                done += 1
                if answer.fault is None:
                    answer = replace(answer, output=order.request.output)
                    _note(order, answer)
                yield answer
    finally:
        for connection, (_, child) in running.items():
            child.kill()
            _ended(connection, child)


def check(orders: Iterable[Order], *, overwrite: bool) -> None:
    """Refuse names of results: of inputs with ValueError, of what no comparison made with FileExistsError."""
    for order in orders:
        placing.check(order.request.files, order.request.inputs, overwrite=overwrite or order.note.is_file())


def all_of(orders: Sequence[Order], *, most: int = 1, resume: bool = True, quiet: bool = True, observe: Observer) -> list[MethodRun]:
    """What each order comes to, in their order; those that were carried out before are taken over with `resume`."""
    done = {order: run for order in orders if resume and (run := kept(order)) is not None}
    missing = [order for order in orders if order not in done]
    by_output = {order.request.output: order for order in missing}
    for run in runs_of(missing, most=most, quiet=quiet, observe=observe):
        done[by_output[run.output]] = run
    return [done[order] for order in orders]


def settled(request: Request) -> Request:
    """Answer every question that a request leaves, without doing it, and what took work to find for good; raises as `prepare` does."""
    with tempfile.TemporaryDirectory() as name:
        task = prepare(request.replaced(output=Path(name) / request.output.name, overwrite=True))
    return request.replaced(motion=task.request.motion, measured=task.request.measured)


def _note(order: Order, run: MethodRun) -> None:
    """Write down what became of an order, for a later run."""
    values = {name: value for name, value in asdict(run).items() if name not in ("method", "output")}
    write_whole({order.note: json.dumps({**values, "fingerprint": _fingerprint(order)}).encode()})


def _ended(connection: Connection, child: BaseProcess) -> None:
    connection.close()
    child.join(processes.GRACE)
    child.kill()
    child.join()


def _serve(connection: Connection, order: Order) -> None:
    """What a process does all its life."""
    last = -_EVERY

    def observe(at: Progress) -> None:
        nonlocal last
        if (now := time.monotonic()) - last >= _EVERY:
            last = now
            connection.send(at)

    connection.send(carried_out(order, observe))


def carried_out(order: Order, observe: Observer) -> MethodRun:
    """What the method comes to in this process."""
    begun, notes, fault = time.perf_counter(), (), None
    try:
        task = prepare(order.request.replaced(overwrite=True))
        notes = (*task.notes, *deblur.carry_out(task, observe).notes)
    except Exception as error:
        fault = error
    return MethodRun(
        method=order.method,
        output=order.request.output,
        seconds=time.perf_counter() - begun,
        peak_bytes=_peak(),
        fault=None if fault is None else _fault(fault),
        unreadable=isinstance(fault, UnreadableError),
        notes=notes,
    )


def _fault(error: Exception) -> str:
    words = " ".join(str(error).split())
    match error:
        case MemoryError():
            return "memory ran out"
        case ValueError() | ArithmeticError() | OSError():
            return words
        case _:
            return f"failed while working: {type(error).__name__}: {words}"


def _peak() -> int:
    """Bytes of memory that the process held at most; 0 where the system does not say."""
    with contextlib.suppress(OSError):  # what getrusage says of a spawned process may be its parent's
        for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) << 10
    try:
        import resource
    except ImportError:
        return 0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _fingerprint(order: Order) -> str:
    return fingerprint.of_values({"request": fingerprint.of_request(order.request), "source": fingerprint.of_source(order.request.source)})
