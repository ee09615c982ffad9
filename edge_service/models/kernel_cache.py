"""Machine code on disk: checked when it is read, and made elsewhere where the process asks for it.

A compiler keeps some 250 MB of what it thought; a process that only loads machine code does not.
Nor does it need numba's translations of Python and numpy, which numba would load before the code;
nor, as long as it compiles nothing at all, the half of LLVM's own code that compiles.
"""

import hashlib
import io
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, cast

import llvmlite
import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.runtime import nrtdynmod
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

Elsewhere = Callable[[bytes], bool]
"""Takes an order, has another process `fill` it, and tells whether that went well."""
_DIGEST_BYTES = hashlib.sha256().digest_size
_elsewhere: list[Elsewhere] = []


def make_elsewhere(elsewhere: Elsewhere) -> None:
    """Let what is missing from the disk be compiled by another process from now on."""
    _elsewhere[:] = [elsewhere]


def fill(order: bytes) -> None:
    """Compile what an order of another process names, onto the disk."""
    module, name, types = pickle.loads(order)
    getattr(import_module(module), name).compile(types)


class KernelCache(FunctionCache):
    """Machine code of one function: damage counts as missing, a full disk as slow."""

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        plain = self._cache_file
        self._cache_file = _CheckedFiles(
            self.cache_path, self._impl.filename_base, plain._source_stamp
        )

    def load_overload(self, types: Any, target: Any) -> Any:
        """Machine code for these argument types; None if this process has to compile it."""
        found = self._loaded(types, target)
        if found is None and _elsewhere:
            order = dumps((self._py_func.__module__, self._py_func.__name__, types))
            if _elsewhere[0](order):
                found = self._loaded(types, target)
            if found is None:  # it would not be there the next time either
                _elsewhere.clear()
                found = self._loaded(types, target)
        return found

    def _loaded(self, types: Any, target: Any) -> Any:
        """Machine code from the disk, without what numba keeps to translate Python."""
        if _elsewhere and not _can_count(target):
            return None
        rtsys.initialize(target)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(types, target)

    def save_overload(self, types: Any, compiled: Any) -> None:
        """Keep machine code, if the disk takes it."""
        with suppress(OSError):
            super().save_overload(types, compiled)


class _CheckedFiles(IndexDataCacheFile):
    """Files of one function that end in the SHA-256 of what stands before."""

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BinaryIO]:
        content = io.BytesIO()
        yield content
        written = content.getvalue()
        with super()._open_for_write(filepath) as file:
            file.write(written + hashlib.sha256(written).digest())

    def _load_index(self) -> Any:
        return super()._load_index() if _is_sound(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        return super()._load_data(name) if _is_sound(self._data_path(name)) else None


def _is_sound(path: str) -> bool:
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-_DIGEST_BYTES]).digest() == content[-_DIGEST_BYTES:]


def _counting(target: Any) -> Any:
    """Functions that count references to arrays: from the disk, where they are kept.

    Numba compiles these few anew in every process, for which 28 MB of LLVM's code are read.
    """
    codegen, files = target.codegen(), _counting_files()
    kept = None if files is None else files.load(codegen.magic_tuple())
    if kept is not None:
        return codegen.unserialize_library(kept)
    functions, library = nrtdynmod.create_nrt_module(target)
    library.enable_object_caching()
    library.add_ir_module(functions)
    library.finalize()
    if files is not None:
        with suppress(OSError):
            Path(files._cache_path).mkdir(parents=True, exist_ok=True)
            files.save(codegen.magic_tuple(), library.serialize_using_object_code())
    return library


def _can_count(target: Any) -> bool:
    """Tell whether nothing has to be compiled to count references, or nothing could be kept."""
    files = _counting_files()
    return rtsys._init or files is None or files.load(target.codegen().magic_tuple()) is not None


def _counting_files() -> _CheckedFiles | None:
    folder = cast(Any, numba.config).CACHE_DIR
    return _CheckedFiles(folder, "counting", llvmlite.__version__) if folder else None


nrtdynmod.compile_nrt_functions = _counting
