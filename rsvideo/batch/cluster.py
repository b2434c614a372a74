"""A cluster's machines as hands: dask.distributed carries orders to them, and nothing else.

Each order is pinned to one idle worker and its future released at once: what Dask does when workers die, which is to compute finished
tasks anew and to blame waiting ones, has nothing to work on. Tries are counted by the run, the ledger is written by the run, and a
chunk is taken from the store if its hash is right.
"""

import contextlib
import logging
import pickle
import queue
import re
import secrets
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version
from multiprocessing.connection import Pipe, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsvideo.batch import errands, machine
from rsvideo.batch.places import Folder, Place
from rsvideo.batch.plan import Batch
from rsvideo.batch.store import Store
from rsvideo.batch.workers import Answer, ClusterError, Crew, Failed, Order, Restore
from rsvideo.config.request import Request
from rsvideo.pipeline import processes

if TYPE_CHECKING:
    from distributed import Client, Future

_CONNECTED = 10.0  # seconds that a scheduler may take to answer
_PATIENCE = 60.0  # seconds without a worker, after which a run ends
_LOOK = 0.5  # seconds from one look at the workers to the next
_ADDRESS = re.compile(r"(tcp|tls)://[^\s/]+:\d{1,5}")


class Cluster:
    """The workers of a scheduler, for chunks; what else there is to do is done by a crew on this machine."""

    tries = 3

    def __init__(
        self, client: "Client", crew: Crew, stores: Place, sources: Sequence[str], tell: Callable[[str], None], *, quiet: bool
    ) -> None:
        self._client, self._crew, self._tell, self._quiet = client, crew, tell, quiet
        self._stores, self._sources = stores, sources
        self._token, self._words = f"run-{secrets.token_hex(8)}", secrets.token_hex()
        self._threads: dict[str, int] = {}  # of the workers that may have orders, by their addresses
        self._refused: dict[str, str] = {}  # why others may not
        self._given: dict[Future, tuple[Restore, str]] = {}
        self._waiting: list[Restore] = []  # orders that a worker could not take after all
        self._ended: queue.SimpleQueue[Future] = queue.SimpleQueue()
        self._ears, self._mouth = Pipe(duplex=False)
        self._looked, self._manned = 0.0, time.monotonic()

    @property
    def busy(self) -> bool:
        """Whether an answer is still to come."""
        return bool(self._given or self._waiting) or self._crew.busy

    @property
    def _idle(self) -> list[str]:
        engaged = {address for _, address in self._given.values()}
        return [address for address in self._threads if address not in engaged]

    def free(self, kind: type[Order]) -> bool:
        """Whether one more order of this kind can be given."""
        return len(self._idle) > len(self._waiting) if kind is Restore else self._crew.free(kind)

    def give(self, order: Order) -> None:
        """Hand a chunk to an idle worker, all else to the crew."""
        if not isinstance(order, Restore):
            self._crew.give(order)
            return
        order.store.make()
        self._waiting.append(order)
        self._hand_out()

    def answers(self) -> Iterator[tuple[Order, Answer]]:
        """Wait until something is reported, for a while; raises ClusterError where the scheduler, or every worker, is gone."""
        self._hand_out()
        crew_ready = wait([*self._crew.connections, self._ears], timeout=_LOOK)
        if any(each is not self._ears for each in crew_ready):
            yield from self._crew.answers()
        while not self._ended.empty():
            self._ears.recv_bytes()
            future = self._ended.get()
            if future in self._given:
                order, address = self._given.pop(future)
                yield from self._answered(order, address, self._result(future, address))
        yield from self._lost()

    def _hand_out(self) -> None:
        idle = self._idle
        while self._waiting and idle:
            order, address = self._waiting.pop(0), idle.pop(0)
            words = pickle.dumps(elsewhere(order))
            future = self._client.submit(
                machine.carry_out,
                words,
                self._threads[address],
                quiet=self._quiet,
                workers=[address],
                allow_other_workers=False,
                pure=False,
            )
            self._given[future] = order, address
            future.add_done_callback(self._hear)

    def _hear(self, future: "Future") -> None:
        """Called by a thread of the client's."""
        self._ended.put(future)
        with contextlib.suppress(OSError):
            self._mouth.send_bytes(b".")

    def _result(self, future: "Future", address: str) -> str | Failed:
        try:
            return errands.answered(future.result(timeout=_CONNECTED))
        except Exception as error:  # whatever a worker's end, or the client's, leads to
            return Failed(words=f"the worker {address} failed: {' '.join(str(error).split()) or type(error).__name__}", again=True)
        finally:
            future.release()

    def _answered(self, order: Restore, address: str, answer: str | Failed) -> Iterator[tuple[Order, Answer]]:
        if isinstance(answer, Failed) and answer.disk is not None:
            self._threads.pop(address, None)
            self._refused[address] = answer.words
            self._tell(f"the worker {address} gets no more orders: {answer.words}")
            if self._threads:
                self._waiting.append(order)
                return
        elif isinstance(answer, str) and not order.store.fetch(order.chunk, answer, order.folder):
            answer = Failed(words=f"the chunk that {address} restored did not arrive whole", again=True)
        yield order, answer

    def _lost(self) -> Iterator[tuple[Order, Answer]]:
        """Look at the workers now and then; the orders of those that are gone."""
        if time.monotonic() - self._looked < _LOOK:
            return
        self.look()
        for future, (order, address) in list(self._given.items()):
            if address not in self._threads and address not in self._refused:
                del self._given[future]
                future.cancel()
                yield order, Failed(words=f"the worker {address} was lost; did its memory run out?", again=True)
        if self._threads:
            self._manned = time.monotonic()
        elif time.monotonic() - self._manned > _PATIENCE:
            raise ClusterError(f"no worker is left{''.join(f'; {address}: {why}' for address, why in self._refused.items())}")

    def look(self) -> None:
        """Find out which workers there are, and whether new ones can work for this run."""
        try:
            there: dict[str, int] = self._client.nthreads(callback_timeout=_CONNECTED)  # pyright: ignore[reportAssignmentType]
        except (OSError, TimeoutError, RuntimeError) as error:
            raise ClusterError(f"the scheduler is gone: {' '.join(str(error).split()) or type(error).__name__}") from error
        self._looked = time.monotonic()
        self._threads = {address: threads for address, threads in self._threads.items() if address in there}
        new = [address for address in there if address not in self._threads and address not in self._refused]
        if new:
            with self._shown():
                for address, fault in self._faults(new).items():
                    if fault is None:
                        self._threads[address] = there[address]
                    else:
                        self._refused[address] = fault
                        self._tell(f"the worker {address} is refused: {fault}")

    @contextlib.contextmanager
    def _shown(self) -> Iterator[None]:
        """A file by which workers prove that they reach what this machine writes."""
        proof = self._stores.within(self._token)
        proof.state(machine.TOKEN, self._words.encode())
        try:
            yield
        finally:
            proof.remove()

    def _faults(self, addresses: Sequence[str]) -> dict[str, str | None]:
        """Why workers cannot work for this run, or None; those that do not answer are left out.

        The version comes first, by Python's own function: a worker of Dask dies of one that it cannot import.
        """
        ours, found = version("rsvideo"), dict[str, str | None]()
        for address, theirs in self._replies(addresses, version, "rsvideo"):
            if isinstance(theirs, Exception):
                found[address] = "it has no rsvideo; pip install 'rsvideo[cluster]' there"
            elif theirs != ours:
                found[address] = f"it has rsvideo {theirs}, the run has {ours}; all machines need the same version"
        same = [each for each in addresses if each not in found]
        for address, fault in self._replies(same, machine.unshared, self._stores, self._token, self._words, self._sources):
            found[address] = f"it fails: {' '.join(str(fault).split())}" if isinstance(fault, Exception) else fault
        return found

    def _replies(self, addresses: Sequence[str], call: Callable[..., Any], *words: object) -> Iterator[tuple[str, Any]]:
        """What workers answer to a call, or raise; nothing of those that are silent."""
        futures = {each: self._client.submit(call, *words, workers=[each], pure=False) for each in addresses}
        for address, future in futures.items():
            try:
                yield address, future.result(timeout=_CONNECTED)
            except TimeoutError:
                continue
            except Exception as error:
                yield address, error
            finally:
                future.release()

    def await_workers(self, address: str) -> None:
        """Wait for a worker that can work for this run; ValueError where there is none."""
        self.look()
        while not self._threads:
            if self._refused:
                raise ValueError(f"no worker of {address} can work for this run, see above; start others, or put them right")
            if time.monotonic() - self._manned > _PATIENCE:
                raise ValueError(f"no worker has joined {address} within {_PATIENCE:.0f} s; start some: dask worker {address}")
            time.sleep(_LOOK)
            self.look()
        self._manned = time.monotonic()


@contextlib.contextmanager
def opened(address: str, batch: Batch, *, jobs: int, tell: Callable[[str], None], quiet: bool) -> Iterator[Cluster]:
    """The cluster at an address, or `local`: `jobs` workers on this machine. ValueError where there is none that can be used.

    The workers must be able to read the batch's sources; `tell` gets a line on each worker that is refused.
    """
    if address != "local" and not _ADDRESS.fullmatch(address):
        raise ValueError(f"scheduler must be local, or an address such as tcp://HOST:8786, got {address[:100]!r}")
    stores = Folder(path=batch.stores.path.absolute()) if isinstance(batch.stores, Folder) else batch.stores
    with contextlib.ExitStack() as stack:
        client = stack.enter_context(_connected(address, jobs, quiet=quiet))
        crew = Crew(most=1 if address == "local" else jobs, threads=processes.threads(jobs), quiet=quiet)
        stack.callback(crew.dismiss)
        cluster = Cluster(client, crew, stores, _read(batch), tell, quiet=quiet)
        cluster.await_workers(address)
        yield cluster


@contextlib.contextmanager
def _connected(address: str, jobs: int, *, quiet: bool) -> "Iterator[Client]":
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ValueError("--scheduler needs dask.distributed; pip install 'rsvideo[cluster]' brings it") from error
    level = logging.CRITICAL if quiet else logging.WARNING
    logging.getLogger("distributed").setLevel(level)
    with contextlib.ExitStack() as stack:
        at: Any = address
        if address == "local":
            options = {"processes": True, "dashboard_address": None, "memory_limit": 0, "silence_logs": level}
            at = stack.enter_context(LocalCluster(n_workers=jobs, threads_per_worker=processes.threads(jobs), **options))
        try:
            client = stack.enter_context(Client(at, timeout=_CONNECTED, set_as_default=False))
        except (OSError, TimeoutError) as error:
            raise ValueError(f"nobody answers at {address} within {_CONNECTED:.0f} s; does dask scheduler run there?") from error
        yield client


def elsewhere(order: Restore) -> Restore:
    """The order for a machine on which nothing is relative to this folder, and nothing gets a name."""
    request, here = order.request, Path.cwd()
    source, output = request.source.absolute(), request.output.absolute()
    absolute = Request.of(source, output, request.files_beside(here), overwrite=True, origin=request.origin)
    place = order.store.place
    store = Store(place=Folder(path=place.path.absolute())) if isinstance(place, Folder) else order.store
    return replace(order, request=absolute.replaced(measured=request.measured), folder=Path(), store=store)


def _read(batch: Batch) -> list[str]:
    """Folders that the workers must see, and an address of each folder of object storage."""
    folders, addresses = set[str](), dict[str, str]()
    for request in (item.request for item in batch.items):
        folders |= {str(path.absolute().parent) for path in request.inputs if not (request.origin and path == request.source)}
        if request.origin:
            addresses.setdefault(request.origin.address.rpartition("/")[0], request.origin.address)
    return [*sorted(folders), *addresses.values()]
