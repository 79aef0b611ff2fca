"""What is installed: all of the package, from where it was installed, with what type checkers look for."""

from __future__ import annotations

import ast
import importlib.metadata
import inspect
import os
from pathlib import Path

import pytest

import jostle
from jostle import _jostle

FOLDER = Path(jostle.__file__).parent


@pytest.mark.skipif("JOSTLE_INSTALLED" not in os.environ, reason="`cargo xtask ci --python` says where")
def test_it_is_the_installed_package() -> None:
    installed = Path(os.environ["JOSTLE_INSTALLED"])
    assert FOLDER.is_relative_to(installed) and Path(_jostle.__file__).is_relative_to(installed)


def test_the_version_is_the_packages() -> None:
    assert jostle.__version__ == importlib.metadata.version("jostle")


def test_type_checkers_find_its_annotations() -> None:
    assert (FOLDER / "py.typed").is_file()
    stub = ast.parse((FOLDER / "_jostle.pyi").read_text(encoding="utf-8"))
    told = {node.name for node in stub.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    there = {name for name, value in vars(_jostle).items() if inspect.isclass(value) or inspect.isbuiltin(value)}
    assert told == there


def test_one_binary_serves_every_python() -> None:
    assert ".abi3." in Path(_jostle.__file__).name or os.name == "nt"


@pytest.mark.parametrize("name", jostle.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    value = getattr(jostle, name)
    if callable(value):
        assert inspect.getdoc(value)
