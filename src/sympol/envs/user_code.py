"""Code of the user's, named by a module or a file: ``my_package``, ``tank.py``, ``plants/tank.py``.

Nothing here needs Gymnasium, so that a command can import what it is told to and stay light.
"""

from __future__ import annotations

import ast
import difflib
import hashlib
import importlib
import importlib.util
import os
import sys
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from .errors import MissingExtra
from .libraries import is_library_id

FILE_ENDING = ".py"
_LONGEST = 1_000_000
"""The largest file, in bytes, in which names are looked for."""


class CodeNotFound(ValueError):
    """There is no such file, module or name; the message offers near ones."""


def is_file(module: str) -> bool:
    """Return whether a module is named by its file.

    Args:
        module: What stands before the colon, such as ``"tank"`` or ``"plants/tank.py"``.

    Returns:
        True for a file, whether it is there or not.
    """
    return module.endswith(FILE_ENDING)


def split(name: str) -> tuple[str, str]:
    """Return what stands before and after the last colon, with the whole path of a file.

    Args:
        name: A name such as ``"plants/tank.py:Tank"``, ``"tank:Tank-v0"`` or ``"CartPole-v1"``.

    Returns:
        The module or the absolute path of its file, and the name in it. The module is empty where there is no colon,
        and for the ids of libraries, which are no names in the user's code.
    """
    if is_library_id(name):
        return "", name
    module, _, inner = name.rpartition(":")
    return (os.path.abspath(os.path.expanduser(module)) if is_file(module) else module), inner


def absolute(name: str) -> str:
    """Return a name with the whole path of its file, so that it means the same in another folder.

    Args:
        name: A name such as ``"plants/tank.py:Tank"``.

    Returns:
        The name as `split` reads it; names without a file are returned as they are.

    Raises:
        CodeNotFound: It is a file without a name in it; with the names that there are.
    """
    module, colon, _ = name.rpartition(":")
    if is_file(name) and not colon:
        there = [f"{name}:{inner}" for inner in names_in(Path(name))]
        hint = f"did you mean {' or '.join(there[:4])}?" if there else f"as in {name}:Name"
        raise CodeNotFound(f"{name} is a file; say what in it is meant: {hint}")
    return ":".join(split(name)) if is_file(module) else name


def short(name: str) -> str:
    """Return a name without the folders of its file.

    Args:
        name: A name such as ``"plants/tank.py:Tank"``.

    Returns:
        The name as it is shown and compared: ``"tank.py:Tank"``. Others are returned as they are.
    """
    module, colon, inner = name.rpartition(":")
    return f"{Path(module).name}{colon}{inner}" if is_file(module) else name


def import_code(module: str) -> ModuleType:
    """Import a module that the user named, by its name or its file.

    A module is looked for in the working folder, too, and the folder of a file is put on the path, as Python does it
    for the program that it runs.

    Args:
        module: The name of a module, or the path of a file that ends in ``.py``.

    Returns:
        The module.

    Raises:
        CodeNotFound: There is no such module or file.
        MissingExtra: It needs a package that is not installed.
        ImportError: Importing it failed; the message has the line.
    """
    if is_file(module):
        path = Path(os.path.realpath(os.path.expanduser(module)))
        if not path.is_file():
            raise CodeNotFound(f"there is no file {module}{_near_files(path)}")
        return loaded_from(path) or _checked(module, lambda: _import_file(path))
    _put_on_path(os.getcwd())
    return _checked(module, lambda: importlib.import_module(module))


def loaded_from(file: Path) -> ModuleType | None:
    """Return the module of a file that is imported already, by whatever name.

    Args:
        file: The file.

    Returns:
        The module, or None.
    """
    path = os.path.realpath(file)
    for module in [*sys.modules.values()]:
        known = getattr(module, "__file__", None)
        if (
            isinstance(known, str)
            and os.path.basename(known) == file.name
            and os.path.realpath(known) == path
        ):
            return module
    return None


def find(module: str, name: str) -> Any:
    """Return what a module or a file of the user's calls by a name.

    Args:
        module: The name of the module, or the path of its file.
        name: The name, perhaps with dots.

    Returns:
        What has the name.

    Raises:
        CodeNotFound: There is no such module, file or name; with the names that there are.
        ImportError: Importing it failed.
    """
    found: Any = import_code(module)
    for part in name.split("."):
        try:
            found = getattr(found, part)
        except AttributeError:
            where = Path(module).name if is_file(module) else f"module {module}"
            there = getattr(sys.modules.get(module), "__file__", module)
            raise CodeNotFound(f"{where} has no {name!r}{offer(Path(there), name)}") from None
    return found


def location(module: str) -> Path | None:
    """Return the file or folder that importing a module would run code of, without importing anything.

    Args:
        module: The name of the module, or the path of its file.

    Returns:
        The path without links, or None where there is no such module or it has no file.
    """
    if is_file(module):
        return Path(os.path.realpath(os.path.expanduser(module)))
    top = module.partition(".")[0]
    loaded = sys.modules.get(top)
    try:
        spec = PathFinder.find_spec(top, [os.getcwd(), *sys.path]) if loaded is None else loaded.__spec__
    except (ImportError, ValueError):
        return None
    places = [] if spec is None else [spec.origin, *(spec.submodule_search_locations or ())]
    found = next((place for place in places if place and os.path.exists(place)), None)
    return None if found is None else Path(os.path.realpath(found))


def offer(file: Path, name: str = "") -> str:
    """Return the part of a message that offers the names of a file, found without running it.

    Args:
        file: The file.
        name: The name that was asked for; near ones come alone.

    Returns:
        Text such as ``"; did you mean Tank?"``, or empty where there is nothing to offer.
    """
    there = list(names_in(file))
    near = difflib.get_close_matches(name.lower(), [known.lower() for known in there], n=3)
    if near:
        return f"; did you mean {' or '.join(known for known in there if known.lower() in near)}?"
    return f"; it has {', '.join(there[:8])}{', ...' if len(there) > 8 else ''}" if there else ""


def names_in(file: Path) -> Iterator[str]:
    """List what a file defines at its top and the ids that it registers, by reading it.

    Args:
        file: The file.

    Yields:
        The names, each once; nothing for a file that cannot be read.
    """
    try:
        if not file.is_file() or file.stat().st_size > _LONGEST:
            return
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError):
        return
    found: list[str] = []
    for node in tree.body:
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name):
                found.append(name)
            case ast.Assign(targets=targets):
                found += [target.id for target in targets if isinstance(target, ast.Name)]
            case ast.AnnAssign(target=ast.Name(id=name)):
                found.append(name)
    yield from dict.fromkeys([name for name in found if not name.startswith("_")] + _registered(tree))


def _registered(tree: ast.Module) -> list[str]:
    """Return the ids that calls of ``register`` name."""
    ids = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            given = [*node.args[:1], *(word.value for word in node.keywords if word.arg in ("id", "name"))]
            if called == "register":
                ids += [v.value for v in given if isinstance(v, ast.Constant) and isinstance(v.value, str)]
    return ids


def _checked(module: str, do_import: Any) -> ModuleType:
    """Import, and say in one line what went wrong."""
    try:
        return do_import()
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if not is_file(module) and (module == missing or module.startswith(f"{missing}.")):
            raise CodeNotFound(
                f"there is no module {missing}; is its folder on PYTHONPATH? A file is named with its ending: "
                f"{missing}.py"
            ) from error
        raise MissingExtra(
            f"module {module} was found, but needs {missing}, which is not installed; install it"
        ) from error
    except (Exception, SystemExit) as error:
        raise ImportError(f"module {module} was found, but importing it failed: {in_words(error)}") from error


def in_words(error: BaseException) -> str:
    """Return an error that code of the user's raised as a part of a message, with its file and line.

    Args:
        error: The error, with its traceback.

    Returns:
        Text such as ``"NameError: name 'x' is not defined (tank.py, line 3)"``.
    """
    said = f"{type(error).__name__}: {error}".removesuffix(": ")
    if isinstance(error, SyntaxError):  # which says the file and the line itself
        return said
    own = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    place, at = "", error.__traceback__
    while at is not None:
        file = at.tb_frame.f_code.co_filename
        if os.path.isfile(file) and not file.startswith((own, sys.base_prefix, sys.prefix)):
            place = f" ({os.path.basename(file)}, line {at.tb_lineno})"
        at = at.tb_next
    return said + place


def _import_file(path: Path) -> ModuleType:
    """Import a file by the name that Python gives it, or by one of its own where another module has that."""
    root, parts = path.parent, [path.stem]
    while (root / "__init__.py").is_file() and root != root.parent:
        root, parts = root.parent, [root.name, *parts]
    _put_on_path(str(root))
    loaded = sys.modules.get(parts[0])
    is_own = loaded is not None and str(root / parts[0]) in getattr(loaded, "__path__", ())
    is_taken = not is_own and (loaded is not None or parts[0] in sys.stdlib_module_names)
    if all(part.isidentifier() for part in parts) and not is_taken:
        importlib.invalidate_caches()  # the file may be younger than what the finder remembers of its folder
        module = importlib.import_module(".".join(parts))
        if os.path.realpath(module.__file__ or "") == str(path):
            return module
    name = f"{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _put_on_path(folder: str) -> None:
    if folder not in sys.path:
        sys.path.insert(0, folder)


def _near_files(path: Path) -> str:
    try:
        there = sorted(file.name for file in path.parent.glob(f"*{FILE_ENDING}"))
    except OSError:
        there = []
    if not path.parent.is_dir():
        return f": there is no folder {path.parent}"
    near = difflib.get_close_matches(path.name, there)
    return f"; did you mean {' or '.join(near)}?" if near else f" in {path.parent}"
