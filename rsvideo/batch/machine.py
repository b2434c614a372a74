"""What a worker of dask.distributed does for a run: nothing but to hand orders to a process of its own, so that heartbeats go on.

Nothing heavy is imported here, since Dask's workers answer the scheduler while they import.
"""

import os
import secrets
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from rsvideo.batch.places import Place
from rsvideo.config import address
from rsvideo.config.files import UnreachableError, UnreadableError

TOKEN = "token"  # the name of the file by which machines prove that they reach one place
_MOST_BYTES = 1000  # of it
_turn = threading.Lock()  # an order of a run that died may still be worked on
_child: "subprocess.Popen[bytes] | None" = None


def unshared(stores: Place, token: str, words: str, sources: Sequence[str]) -> str | None:
    """Why this machine cannot exchange files with the run, or None.

    In the place `token` of the stores, a file holds `words` where both reach the same, and this machine leaves one that the run removes.
    `sources` are folders, and addresses of objects, that it must be able to read.
    """
    at, proof = stores.at(), stores.within(token)
    try:
        if proof.read(TOKEN, most=_MOST_BYTES) != words.encode():
            return f"it finds in {at} what the run has not written there; all machines need the same place under one name"
        proof.state(secrets.token_hex(8), b".")
        for at in sources:
            if address.is_address(at):
                from rsvideo.batch import objects

                objects.check_readable(at)
            elif not Path(at).is_dir():
                raise FileNotFoundError(at)
    except UnreachableError as error:
        return f"it cannot use {error.filename}: {error.strerror}"
    except (OSError, UnreadableError):
        return f"it does not see {at}, or may not write there; all machines need one disk under one name"
    except ValueError as error:  # what it lacks
        return f"it cannot use {at}: {error}"
    return None


def carry_out(order: bytes, threads: int, *, quiet: bool) -> bytes:
    """Restore a chunk in this machine's child process, which stays for the next order; the answer as JSON (`errands.py`)."""
    global _child
    with _turn:
        if _child is None or _child.poll() is not None:
            words = [sys.executable, "-m", "rsvideo.batch.errands", str(threads), *(["quiet"] if quiet else [])]
            environment = os.environ | {"PYTHONSAFEPATH": "1"}
            _child = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, start_new_session=True)
        assert _child.stdin is not None
        assert _child.stdout is not None
        try:
            _child.stdin.write(order)
            _child.stdin.flush()
        except OSError:  # it has died, which the empty answer says too
            pass
        if answer := _child.stdout.readline():
            return answer
        raise RuntimeError(f"its process ended with exit code {_child.wait()}")
