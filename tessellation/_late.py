"""Names of a package that are imported when they are first used: importing the package then costs nothing."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module


def late(package: str, home: Mapping[str, str]) -> Callable[[str], object]:
    """A package's `__getattr__`, which finds its names by the module that each is in, and keeps them."""

    def find(name: str) -> object:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{home[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    return find
