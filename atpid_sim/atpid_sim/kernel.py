# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: cached, without the interpreter's lock, and with IEEE arithmetic; and where they are kept.

Every kernel takes one of these decorators. The error model is named in them: a function that names none takes it from
the function that first compiles it, and with Python's error model steps take 2.4 times as long
(docs/decisions/0007-integration.md). With numpy's, a division by zero gives infinity or NaN, which every run reports as
a named outcome. There is no fast-math: error bounds are proven for IEEE operations.

numba keys a cached function on the place and contents of its own file, not on the files of the functions it calls:
after an update of one file the others would go on with the old code, and each copy of the sources, in a checkout or
installed, would be compiled again. So modules that call each other share a folder named after the contents of all of
them. Other functions, those of the user's own programs included, are kept where numba keeps them by default.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from numba import config, njit, types
from numba.core.caching import InTreeCacheLocator
from numba.extending import overload

from atpid_common.entry_points import CONTACT_LAWS, sources
from atpid_common.folders import cache_root, content_key

#: Folder of the cache for each source file.
_FOLDERS: dict[str, str] = {}
_NUMBAS_OWN = "UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,IPythonCacheLocator,ZipCacheLocator"


class SharedCacheLocator(InTreeCacheLocator):  # type: ignore[misc]
    """Leads numba to the folder of a source file; for a file without one numba asks the next locator in its list."""

    def get_cache_path(self) -> str:
        """Return the folder of the function's source file."""
        return _FOLDERS[self._py_file]

    @classmethod
    def from_function(cls, py_func: Callable[..., object], py_file: str) -> SharedCacheLocator | None:
        """Return the locator of a function, None if its file has no folder here."""
        if py_file not in _FOLDERS:
            return None
        found: SharedCacheLocator | None = super().from_function(py_func, py_file)
        return found


def share_cache(name: str, sources: Iterable[Path], used: Iterable[Path] = ()) -> None:
    """Keep the compiled functions of these modules in `<cache>/<name>-<key of their contents>`.

    used: further modules whose functions they call, which are part of the key. To be called before they are imported.
    `<cache>` is NUMBA_CACHE_DIR where that is set, else the project's folder in the user's cache.
    """
    files = sorted(sources)
    known = sorted({*files, *used})
    key = content_key(Path(os.path.commonpath(known)), known)
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or cache_root()) / f"{name}-{key}"
    _FOLDERS.update({str(path): str(folder / path.parent.name) for path in files})
    ours = f"{__name__}.{SharedCacheLocator.__name__}"
    others = config.CACHE_LOCATOR_CLASSES or _NUMBAS_OWN
    if ours not in others.split(","):
        config.CACHE_LOCATOR_CLASSES = f"{ours},{others}"


#: Packages with kernels, and the modules from which these take decorators, outcomes and parameters.
_PACKAGES = ("engine", "contact")
_SHARED = ("fields.py", "kernel.py", "kernel_inputs.py", "outcome.py", "root.py", "system.py")

_HERE = Path(__file__).parent
KERNEL_SOURCES = frozenset(
    [
        *(path for name in _PACKAGES for path in (_HERE / name).glob("*.py")),
        *(_HERE / name for name in _SHARED),
        *sources(CONTACT_LAWS),
    ]
)
share_cache("kernels", KERNEL_SOURCES)

kernel = njit(cache=True, nogil=True, error_model="numpy")
#: For what a library calls from Python at every evaluation: releasing the lock each time takes 5 % of a run by odeint.
callback = njit(cache=True, error_model="numpy")
inlined = njit(cache=True, nogil=True, error_model="numpy", inline="always")
#: For functions that make no array, are returned none and return none: numba counts no references to those they are
#: given. Only where that pays although a run's arrays have no owner (`modal_room.unowned`): 8 % of a run at `finite`.
lean = njit(cache=True, nogil=True, error_model="numpy", _nrt=False)


def chosen(one: Callable[..., object], several: Callable[..., object]) -> Callable[..., Any]:
    """Return a function for kernels: `one` where its first argument is None, else `several`.

    Which of them is decided when the caller is compiled, so that the results may have different types; both take the
    same arguments.
    """

    def function(*_: object) -> None:
        raise NotImplementedError("compiled code only")

    @overload(function, inline="always", strict=False)  # type: ignore[untyped-decorator]
    def by_type(*arguments: object) -> Callable[..., object]:
        return one if isinstance(arguments[0], types.NoneType) else several

    return function
