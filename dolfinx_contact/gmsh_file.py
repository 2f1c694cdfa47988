# SPDX-License-Identifier: MIT
"""Files that gmsh reads, beside a session of gmsh that the user may have."""

from __future__ import annotations

import contextlib
import inspect
import os
from pathlib import Path
from typing import Any, Iterator

from .errors import InputError


@contextlib.contextmanager
def gmsh_model(path: Path, who: str) -> Iterator[Any]:
    """gmsh's model of a file, while the context lasts; a session of the user's goes on after it.

    Args:
        path: of the file
        who: begins the messages of errors

    Raises:
        InputError: there is no such file, or gmsh cannot read it
    """
    import gmsh

    if not path.is_file():
        raise InputError(f"{who}: there is no file {str(path)!r}; give the name of a file.")
    ours = not is_running(gmsh)
    if ours:
        known = inspect.signature(gmsh.initialize).parameters
        gmsh.initialize(**({"interruptible": False} if "interruptible" in known else {}))
    before = gmsh.option.getNumber("General.Terminal")
    model = gmsh.model.getCurrent()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("dolfinx_contact")
    try:
        gmsh.merge(str(path))
        yield gmsh.model
    except InputError as error:
        raise InputError(f"{who}: {str(path)!r}: {error.args[0]}") from None
    except Exception as error:  # gmsh raises plain Exception
        raise InputError(
            f"{who}: gmsh cannot read {str(path)!r} ({error}); give a whole file that gmsh has written,"
            " of a format that it knows."
        ) from None
    finally:
        gmsh.model.remove()
        gmsh.model.setCurrent(model)
        gmsh.option.setNumber("General.Terminal", before)
        if ours:
            gmsh.finalize()


def is_running(gmsh: Any) -> bool:
    """Whether gmsh has been initialised. Up to 4.8 it does not say, but then has no model, and
    complains on stderr."""
    if hasattr(gmsh, "isInitialized"):
        return bool(gmsh.isInitialized())
    stderr = os.dup(2)
    try:
        with open(os.devnull, "w") as null:
            os.dup2(null.fileno(), 2)
        return len(gmsh.model.list()) > 0
    except Exception:
        return False
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
