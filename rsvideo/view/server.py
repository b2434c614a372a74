"""The server: bound to this machine alone, asleep as long as nobody asks for anything."""

import asyncio
import contextlib
import signal
import socket
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import uvicorn

from rsvideo.config.placing import SIGNALS
from rsvideo.view import access
from rsvideo.view.app import Room, application
from rsvideo.view.errands import COMMAND, state_folder
from rsvideo.view.opened import Opened

_PATIENCE = 2  # seconds that a request may take once the server is to end
_IDLE = 30  # seconds that a connection may be idle


class _Server(uvicorn.Server):
    """uvicorn's server without its clock, which would wake it ten times a second."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.ended = asyncio.Event()

    async def main_loop(self) -> None:
        """Wait for the end."""
        await self.on_tick(0)
        await self.ended.wait()

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """They are taken by the loop instead."""
        yield


def serve(
    opened: Opened,
    *,
    port: int,
    ready: Callable[[str], None],
    command: Sequence[str] = COMMAND,
    state: Path | None = None,
) -> None:
    """Serve the pages until a signal ends it; `ready` gets the address, with its token, once connections are taken.

    `command` is how rsvideo is called for what the pages start; OSError where the port is taken.
    """
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_STREAM)) as listening:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(("127.0.0.1", port))
        listening.listen()
        token, taken = access.new_token(), listening.getsockname()[1]
        room = Room(opened, state or state_folder(), command)
        gate = access.Gate(application(room), token, taken)
        config = uvicorn.Config(
            gate,
            lifespan="off",
            access_log=False,
            log_config=None,
            server_header=False,
            date_header=False,
            timeout_keep_alive=_IDLE,
            timeout_graceful_shutdown=_PATIENCE,
            ws="none",
            http="h11",
            loop="asyncio",
        )
        try:
            asyncio.run(_until_signal(config, listening, lambda: ready(f"http://127.0.0.1:{taken}/{token}/")))
        finally:
            room.close()


async def _until_signal(config: uvicorn.Config, listening: socket.socket, ready: Callable[[], None]) -> None:
    server = _Server(config)

    def end() -> None:
        server.should_exit = True
        server.ended.set()

    loop = asyncio.get_running_loop()
    for number in SIGNALS:
        try:
            loop.add_signal_handler(number, end)
        except (NotImplementedError, RuntimeError):  # on Windows
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(end))
    ready()
    await server.serve(sockets=[listening])
