"""How the simulation is compiled: numba, without the GIL, cached on disk.

numba's cache knows when the file of a function changes, but not the files of the functions it
calls: a changed law would go on being integrated with the old one. The cache folder is therefore
named after the text of all compiled files together, and of this one.

numba unpickles what lies in its cache, so whoever can write there runs code here: the folder is a
private one.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

# LLVM's second level takes less time than its third, which is numba's own choice, and the golden
# values have the same bits: what the third adds, these loops cannot use.
os.environ.setdefault("NUMBA_OPT", "2")
try:
    import numba
except ValueError as error:  # it reads its settings when it is loaded
    raise ValueError(f"numba: {error} Look at NUMBA_… in the environment") from None

from llvmlite import ir
from numba.extending import intrinsic

Compiler = Callable[[Callable[..., Any]], Callable[..., Any]]


def _cache_folder(sources: Sequence[Path]) -> str | None:
    """A folder that nobody else can write to; None where there is none: nothing is cached."""
    text = b"".join(path.read_bytes() for path in (Path(__file__), *sources))
    name = f"numba-{numba.__version__}-{hashlib.sha256(text).hexdigest()[:16]}"
    folder = private_folder(sources[0].parent / "__pycache__", name)
    return None if folder is None else str(folder)


_one_at_a_time = Lock()  # numba's cache folder is one setting of all threads


@contextmanager
def _caching_in(folder: str | None) -> Iterator[None]:
    """Let numba cache in a folder what is compiled meanwhile."""
    with _one_at_a_time:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = folder or before
        try:
            yield
        finally:
            numba.config.CACHE_DIR = before


def _for_any_number(compiled: Any) -> Any:
    """Call f(0) and f(n) alike: numba would compile f again for every number of a caller."""
    template = compiled.get_call_template
    compiled.get_call_template = lambda args, kws: template(
        tuple(numba.types.unliteral(arg) for arg in args), kws
    )
    return compiled


def _hidden(inlined: Any) -> Any:
    """Compiled into its callers alone; Python that calls it runs its Python.

    A wrapper for such calls would take time to compile.
    """
    inlined._insert = lambda *overload: None  # calls from Python choose among wrappers
    inlined._compile_for_args = lambda *args, **named: inlined.py_func
    return inlined


def compilers(
    *sources: Path, contract: bool = False, reassociate: bool = False, allocate: bool = True
) -> tuple[Compiler, Compiler]:
    """Two decorators for functions that are defined in `sources` and call each other.

    The first compiles at the first call in a fresh clone, later ones read the cache; the second
    compiles into its callers, for functions whose call costs more than they do. `contract` lets
    a product and a sum round once, `reassociate` lets a long sum be taken in parts. No other fast
    mathematics: the same inputs give the same bits in every process, and NaN is found.

    Functions that need not `allocate` arrays count no references to them, which takes time.
    Arrays are copied element by element: `a[:] = b` would compile messages about shapes, too,
    which takes seconds. So do two layouts of an array in two calls.
    """
    folder = _cache_folder(sources)
    allowed = {name for name, on in (("contract", contract), ("reassoc", reassociate)) if on}

    def compiler(inline: bool) -> Compiler:
        def compile_one(function: Callable[..., Any]) -> Callable[..., Any]:
            with _caching_in(folder):
                made = numba.njit(
                    cache=folder is not None,
                    nogil=True,
                    error_model="numpy",
                    forceinline=inline,
                    fastmath=allowed or False,
                    no_cfunc_wrapper=True,
                    _nrt=allocate,
                    no_cpython_wrapper=inline,
                )(function)
            if numba.config.DISABLE_JIT:  # for a debugger: Python runs the function as it is
                return function
            return _for_any_number(_hidden(made) if inline else made)

        return compile_one

    return compiler(False), compiler(True)


# Functions that are compiled when they are first needed, and called by their address.


def call_entry(place: int, signature: Any, python: Callable[..., Any]) -> Callable[..., Any]:
    """What compiled code calls: a function of a table, whose address is the first argument.

    It takes the other arguments. Python and translators run `python`, with all arguments.
    """
    if numba.config.DISABLE_JIT:
        return python

    def generate(context: Any, builder: Any, given: Any, values: Any) -> Any:
        word = context.get_value_type(numba.types.intp)
        kinds = [context.get_value_type(kind) for kind in given.args[1:]]
        function = ir.FunctionType(context.get_value_type(given.return_type), kinds)
        entry = builder.add(values[0], word(place * (word.width // 8)))
        address = builder.load(builder.inttoptr(entry, word.as_pointer()))
        return builder.call(builder.inttoptr(address, function.as_pointer()), values[1:])

    def typed(typing: Any, *arguments: Any) -> Any:
        return signature.return_type(numba.types.intp, *signature.args), generate

    names = inspect.signature(python).parameters.values()
    first = inspect.Parameter("typing", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    setattr(typed, "__signature__", inspect.Signature([first, *names]))  # noqa: B010
    call = intrinsic(typed)
    call.py_func = getattr(python, "py_func", python)
    return call


def address_of(
    function: Callable[..., Any], signature: Any, *sources: Path, allocate: bool = True
) -> int:
    """Address of a function, compiled or read from the cache of `sources`."""
    folder = _cache_folder(sources)
    settings = {"cache": folder is not None, "error_model": "numpy", "_nrt": allocate}
    with _caching_in(folder):
        compiler = numba.cfunc(signature, **settings)
        return int(compiler(getattr(function, "py_func", function)).address)


# A folder for what a program keeps between its runs, where nobody else can write.
#
# Whoever can write there decides what the next run does: with the code, else among the user's own
# caches, else nowhere.


def private_folder(beside: Path, name: str) -> Path | None:
    """A folder of that name in `beside`, or among the user's caches; None where there is none."""
    for base in (beside, _of_the_user()):
        if base is not None and _made_private(base) and _made_private(base / name):
            return base / name
    return None


def _of_the_user() -> Path | None:
    """The user's own caches, as the XDG base directories say; None without a home."""
    named = os.environ.get("XDG_CACHE_HOME", "")
    try:
        caches = Path(named) if os.path.isabs(named) else Path.home() / ".cache"
        caches.mkdir(0o700, parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        return None
    return caches / "structural-model-zoo"


def _made_private(folder: Path) -> bool:
    """Whether this is a folder, made here if need be, that its owner alone, who we are, can write.

    A link is none: it leads where others may decide.
    """
    try:
        folder.mkdir(0o700, exist_ok=True)
        seen = folder.lstat()
    except OSError:
        return False
    if not stat.S_ISDIR(seen.st_mode) or not os.access(folder, os.W_OK):
        return False
    if not hasattr(os, "getuid"):  # Windows: no such bits, and its folders of a user are private
        return True
    return seen.st_uid == os.getuid() and not seen.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
