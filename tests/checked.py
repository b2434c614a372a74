"""Shapes and types of arguments and results, checked while tests run.

jaxtyping's import hook decorates every function. To decorate takes a millisecond and to check 33 us, which is more than many a function
takes itself. So a function is decorated when it is first called, and only the first calls of each test are checked.
"""

from collections.abc import Callable
from functools import wraps
from inspect import isclass
from typing import Any

import jaxtyping

PACKAGES = "rsvideo", "calibration"
CHECKER = "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))"  # an int is a float here, as PEP 484 has it
MOST = 50  # calls of each function that are checked in a test

_jaxtyped = jaxtyping.jaxtyped
_calls: dict[Callable[..., Any], int] = {}


def install() -> None:
    """For all modules that are imported from now on; compiled kernels carry @no_type_check."""
    jaxtyping.jaxtyped = sparing
    jaxtyping.install_import_hook(PACKAGES, CHECKER)


def begin() -> None:
    """Check all functions again: another test begins."""
    _calls.clear()


def sparing(*, typechecker: Callable[..., Any]) -> Callable[[Any], Any]:
    """As `jaxtyping.jaxtyped`, for the first calls of a function; for a class as it is."""

    def decorated(function: Any) -> Any:
        if isclass(function):
            return _jaxtyped(function, typechecker=typechecker)
        checked: list[Callable[..., Any]] = []

        @wraps(function)
        def called(*args: Any, **kwargs: Any) -> Any:
            calls = _calls[function] = _calls.get(function, 0) + 1
            if calls > MOST:
                return function(*args, **kwargs)
            if not checked:
                checked.append(_jaxtyped(function, typechecker=typechecker))
            return checked[0](*args, **kwargs)

        return called

    return decorated
