"""Every module of the studies can be imported, and every command among them explains itself."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MODULES = sorted(
    ".".join(file.relative_to(ROOT).with_suffix("").parts)
    for file in (ROOT / "studies").rglob("*.py")
    if file.stem not in ("__main__", "__init__")  # the two that only call others
)


@pytest.mark.parametrize("name", MODULES)
def test_it_can_be_imported_and_explains_itself(name, monkeypatch, capsys):
    module = importlib.import_module(name)
    assert module.__doc__
    if getattr(getattr(module, "main", None), "__module__", None) != name:  # it imports another main, or none
        return
    monkeypatch.setattr("sys.argv", [name, "--help"])
    with pytest.raises(SystemExit) as stopped:
        module.main()
    assert stopped.value.code in (0, None)
    assert f"python -m {name}" in capsys.readouterr().out
